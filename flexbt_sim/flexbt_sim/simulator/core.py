# SPDX-License-Identifier: BSD-3-Clause
"""The simulator without its services: it steps a world and publishes the topics of its robots."""

from __future__ import annotations

import contextlib
import threading
import traceback
from collections.abc import Set
from functools import partial
from typing import Any, Final

from action_msgs.msg import GoalStatus, GoalStatusArray
from builtin_interfaces.msg import Time
from rcl_interfaces.msg import SetParametersResult
from rclpy.event_handler import SubscriptionEventCallbacks
from rclpy.exceptions import InvalidHandle
from rclpy.parameter import Parameter
from rclpy.qos import QoSDurabilityPolicy, QoSProfile, ReliabilityPolicy
from rosgraph_msgs.msg import Clock
from std_srvs.srv import Trigger

from flexbt_common import names
from flexbt_common.lifecycle.liveliness import LivelinessToken
from flexbt_common.runtime.node_runtime import NodeRuntime
from flexbt_sim.errors import SimulationError
from flexbt_sim.intra_process import IntraProcessTopics
from flexbt_sim.world.faults import Fault
from flexbt_sim.world.pacing import Pacer
from flexbt_sim.world.plane.geometry import Pose
from flexbt_sim.world.robot import Robot
from flexbt_sim.world.scenery import Entity
from flexbt_sim.world.world import EntityModel, prepare_world

from .displays import Scene
from .map_server import MapServer
from .message_template import MessageTemplate, stamp_fields
from .parameters import SPEED_FACTOR, SimulatorParameters, declare_simulator_parameters
from .robot_topics import Commands, Message, RobotTopics


class SimulatorCore:
    """A world that runs on its own thread, with the operations that its services need.

    Hold ``lock`` to step, inspect or change the world; reading a single attribute does not need it. Call methods that
    do not need the lock on the executor thread.
    """

    def __init__(self, runtime: NodeRuntime, in_process: IntraProcessTopics | None = None) -> None:
        """Must be called off the executor thread. ``in_process`` receives the topics that are shared within the
        process.

        Raises:
            SimulationError: a parameter, the world or the map is invalid.
        """
        self.runtime = runtime
        self._in_process = in_process or IntraProcessTopics()
        self.parameters: SimulatorParameters = runtime.call(lambda: declare_simulator_parameters(runtime.node))
        self.lock = threading.Lock()
        self.world = self.parameters.make_world()
        self.pacer = Pacer(float(runtime.node.get_parameter(SPEED_FACTOR).value), runtime.post)
        self._began = 0
        """Time of the world, ns, at which the clock was 0."""
        self._steps = 0
        self._set_periods()
        self._robots: dict[str, RobotTopics] = {}
        self._logged_faults = frozenset[Fault]()
        self._logged_violations: dict[str, int] = {}
        self._spawned: dict[str, str] = {}
        """Entities that were spawned by a service, with their requested namespaces."""
        self._map_servers: dict[str, MapServer] = {}
        self._token = LivelinessToken(runtime)
        runtime.call(self._connect)
        self._can_cast = False
        threading.Thread(target=self._compile, name='compile', daemon=True).start()
        self._thread = threading.Thread(target=self._run, name='world', daemon=True)
        runtime.on_close(self._close)
        self._thread.start()
        runtime.node.get_logger().info(f'{self.parameters.source}: {self._described()}')

    def _set_periods(self) -> None:
        """Set the periods of messages, in steps. Each message wakes every node that receives it, which is most of the
        cost of an idle simulation, over all processes. So poses of a robot at rest are sent with every second message
        of /clock. /clock itself must be faster than the activities that depend on it, such as ticking a tree every 0.1
        s."""

        step = self.world.step_size
        self._steps_per_odom = max(1, round(1.0 / (self.parameters.odom_rate * step)))
        at_rest = max(1, int(1.0 / (self.parameters.clock_rate * step) + 1e-9))  # no slower than clock_rate
        self._steps_per_clock = {True: min(self._steps_per_odom, at_rest), False: at_rest}
        self._steps_per_rest = max(self._steps_per_odom, 2 * at_rest)

    def _compile(self) -> None:
        """Compile the loops in a separate thread: otherwise the world would stop for seconds."""
        prepare_world()
        self._can_cast = True

    def _described(self) -> str:
        world = self.world
        size = 'a plane' if world.map is None else f'{world.map.width} x {world.map.height} cells'
        robots = [f'{name} at ({one.pose.x:g}, {one.pose.y:g})' for name, one in world.robots.items()]
        shown = robots if len(robots) <= 5 else [*robots[:5], f'{len(robots) - 5} more']
        return f'{size}; {", ".join(shown) or "no robot"}'

    def _connect(self) -> None:
        node = self.runtime.node
        clock_qos = QoSProfile(depth=1, reliability=ReliabilityPolicy.RELIABLE)
        self._clock = node.create_publisher(Clock, names.CLOCK, clock_qos)
        self._clock_bytes = MessageTemplate(Clock(), *stamp_fields('clock'))
        self._computations = Computations(self.runtime, self.pacer)
        for robot in self.world.robots.values():
            self._connect_robot(robot, self.parameters.namespace_of(robot.name))
        self._scene = Scene(self.runtime, self.parameters.map_frame)
        with self.lock:
            self._tell_scene()
        node.create_service(Trigger, names.RESET, self._on_reset)
        node.add_on_set_parameters_callback(self._on_parameters)

    # -- on the executor thread --------------------------------------------------------------------------------------

    def _let_read(self, robot: Robot) -> None:
        """Let the sensors of a new robot measure, but cast no beams while that is compiled."""
        for device in robot.devices.values():
            device.is_read = self._can_cast or not device.casts

    def _connect_robot(self, robot: Robot, namespace: str) -> None:
        """Create the topics of a new robot."""
        commands = Commands(self._drive, self._initial_pose, self._grip, lambda: self.world.time)
        topics = RobotTopics(self.runtime, robot, namespace, self.parameters, commands, self._in_process)
        self._map_servers[robot.name] = MapServer(
            self.runtime, namespace, self.parameters.map_frame, self.world.map, self.parameters.allowed_directories
        )
        self._token.add_name(self._stands_in_for(namespace))
        self._robots = self._robots | {robot.name: topics}  # a new dict: the world's thread iterates over the old
        self._watch_computations()

    def _disconnect_robot(self, name: str) -> None:
        """Remove the topics of a removed robot."""
        topics = self._robots[name]
        with self.lock:
            self._robots = {key: value for key, value in self._robots.items() if key != name}
        self.pacer.forget_driver(name)
        if topics.namespace:
            self._token.remove_name(self._stands_in_for(topics.namespace))
        self._map_servers.pop(name).close()
        topics.close()
        self._watch_computations()

    def _serve_entities(self) -> None:
        """Update the services that depend on the doors and the no-go zones, which may have changed."""

    def _stands_in_for(self, namespace: str) -> str:
        """Return the name of the simulator in the namespace of a robot, where the robot's nodes look for it."""
        return f'{self.runtime.node.get_namespace().rstrip("/")}/{namespace}{self.runtime.name}'

    def _watch_computations(self) -> None:
        """Watch for nodes that compute, if the world runs as fast as possible and must wait for them."""
        namespaces = {topics.namespace for topics in self._robots.values()} if self.pacer.factor == 0.0 else set()
        self._computations.watch(namespaces)

    # -- for the services --------------------------------------------------------------------------------------------

    @property
    def namespaces(self) -> list[str]:
        """Namespaces of the robots' topics, relative to that of the node: '' or 'robot1/'."""
        return [topics.namespace for topics in self._robots.values()]

    def stamp(self) -> Time:
        """Return the time of the clock."""
        seconds, nanoseconds = divmod(self.world.nanoseconds - self._began, 1_000_000_000)
        return Time(sec=seconds, nanosec=nanoseconds)

    def spawn(self, name: str, model: EntityModel, pose: Pose | None, namespace: str) -> None:
        """Add an entity, and the topics of a robot, in a namespace of its name unless another one is given.

        Raises:
            SimulationError: it does not fit there.
        """
        with self.lock:
            entity = self.world.add(name, model, pose)
            if isinstance(entity, Robot):
                self._let_read(entity)
            self._tell_scene()
        self._spawned[name] = namespace
        if isinstance(entity, Robot):
            self._connect_robot(entity, f'{namespace or entity.name}/')
        self._serve_entities()

    def is_free_namespace(self, namespace: str) -> bool:
        """Return whether no robot uses this namespace."""
        return f'{namespace}/' not in {topics.namespace for topics in self._robots.values()}

    def remove(self, entity: Entity) -> None:
        """Remove an entity."""
        if isinstance(entity, Robot):
            self._disconnect_robot(entity.name)
        with self.lock:
            self.world.remove(entity.name)
            self._tell_scene()
        self._spawned.pop(entity.name, None)
        self._serve_entities()

    def remove_spawned(self) -> None:
        """Remove all entities that were spawned by a service."""
        for name in list(self._spawned):
            self.remove(self.world.entities[name])

    def move(self, entity: Entity, pose: Pose) -> None:
        """Put an entity at a pose. Raises SimulationError if it does not fit there."""
        with self.lock:
            self.world.move(entity.name, pose)
            self._tell_scene()
        self.pacer.forget_driver(entity.name)
        self._serve_entities()

    def reset_state(self) -> None:
        """Put everything back where it was at the start; time continues.

        Raises:
            SimulationError: two entities would overlap; nothing is changed.
        """
        with self.lock:
            self.world.reset()
            self._tell_scene()
        self.pacer.forget_drivers()
        self._serve_entities()

    def reset_time(self) -> None:
        """Set the clock to 0."""
        with self.lock:
            self._began = self.world.nanoseconds

    def restart(self) -> None:
        """Restart, as if the simulator had just been started.

        Raises:
            SimulationError: the world can no longer be created.
        """
        world = self.parameters.make_world()
        for new in world.robots.values():
            self._let_read(new)
        for name, topics in list(self._robots.items()):
            robot = world.robots.get(name)
            if name in self._spawned or robot is None or robot.model != topics.robot.model:  # the file was changed
                self._disconnect_robot(name)
        with self.lock:
            self.world, self._began, self._steps = world, 0, 0
            self._set_periods()
            self._spawned.clear()
            for name, topics in self._robots.items():
                topics.restart(world.robots[name])
            self._tell_scene()
        self.pacer.forget_drivers()
        for map_server in self._map_servers.values():
            map_server.restart(world.map)
        for robot in world.robots.values():
            if robot.name not in self._robots:
                self._connect_robot(robot, self.parameters.namespace_of(robot.name))
        self._serve_entities()

    def has_navigation(self, robot: str) -> bool:
        """Return whether a robot has a node navigation, which carries out the faults of its servers."""
        return self._robots[robot].has_navigation

    def publish_faults(self) -> None:
        """Publish the faults of the navigation servers, even while time is paused."""
        with self.lock:
            self._publish_faults()

    def _publish_faults(self) -> None:
        for topics in self._robots.values():
            topics.publish_server_faults()

    def _events(self) -> list[str]:
        """Return the faults that have begun or ended, and the robots that have entered a no-go zone."""
        events = []
        for robot in self.world.robots.values():
            if robot.violations > self._logged_violations.get(robot.name, 0):
                there = [name for name in robot.zones if self.world.zones[name].model.kind == 'no_go']
                events.append(f'{robot.name} has entered a no-go zone: {", ".join(there)}')
        self._logged_violations = {name: robot.violations for name, robot in self.world.robots.items()}
        begun = self.world.begun_faults
        for faults, what in ((begun - self._logged_faults, 'begins'), (self._logged_faults - begun, 'is over')):
            for one in sorted(faults, key=lambda one: (one.begins, one.entity, one.parameters.slot)):
                events.append(f'{one.entity}: {one.parameters} {what}')
        self._logged_faults = begun
        return events

    def _tell_scene(self) -> None:
        """Publish the scene for displays if it has changed, even while time is paused. Requires the lock."""
        self._scene.tell(self.world, self.stamp())

    # -- on the executor thread --------------------------------------------------------------------------------------

    def _drive(self, robot: Robot, linear: float, angular: float) -> None:
        with self.lock:
            if self.world.robots.get(robot.name) is not robot:
                return  # the robot was removed meanwhile: do not wait for its driver
            now = self.world.time
            robot.command(linear, angular, now)
            until = now + robot.model.drive.watchdog
            self.pacer.command_received(robot.name, now, until, is_stopping=linear == angular == 0.0)

    def _grip(self, robot: Robot, close: bool) -> str:
        with self.lock:
            name = self.world.grip(robot.name) if close else self.world.release(robot.name)
            self._tell_scene()
            return name

    def _initial_pose(self, robot: Robot, pose: Pose) -> None:
        with self.lock:
            if self.parameters.initialpose_moves:
                self.world.move(robot.name, pose)
            else:
                self.world.check_place(robot.name, pose)
                robot.localize(pose)
        if self.parameters.initialpose_moves:
            self.pacer.forget_driver(robot.name)

    def _on_reset(self, request: Any, response: Any) -> Any:
        try:
            self.reset_state()
            response.success = True
            response.message = 'everything is where it was at the start; the time continues'
        except SimulationError as error:
            response.message = str(error)
        return response

    def _on_parameters(self, changes: list[Parameter]) -> SetParametersResult:
        for change in changes:
            if change.name == SPEED_FACTOR:
                self.pacer.factor = float(change.value)
                self.runtime.post(self._watch_computations)
        return SetParametersResult(successful=True)

    # -- on the thread of the world ----------------------------------------------------------------------------------

    def _run(self) -> None:
        try:
            with self.runtime.health.loop('the world') as loop:
                while True:
                    per_clock = self._look_round()
                    with loop.resting():
                        steps, is_single = self.pacer.begin(per_clock - self._steps % per_clock)
                    if steps == 0:
                        return
                    made = sum(self._step(is_single, per_clock) for _ in range(steps))
                    with loop.resting():
                        self.pacer.wait(made, made * self.world.step_size, self.world.time)
        except BaseException as error:  # without a world there is nothing to simulate
            self.runtime.abort(f'the world raised: {"".join(traceback.format_exception(error)).rstrip()}')

    def _look_round(self) -> int:
        """Determine the subscribers, and thus the number of steps between two messages of /clock."""
        with self.lock:
            for topics in self._robots.values():
                topics.look_round(self.world.time, can_cast=self._can_cast)
            return self._steps_per_clock[any(topics.is_busy for topics in self._robots.values())]

    def _step(self, is_single: bool, per_clock: int) -> bool:
        """Make a step and return True, or return False if it is no longer due (:meth:`Pacer.may_step`)."""
        messages: list[Message] = []
        with self.lock:
            if not self.pacer.may_step(is_requested=is_single):
                return False
            self.world.step()
            self._steps += 1
            self._publish_faults()
            events = self._events()
            stamp = divmod(self.world.nanoseconds - self._began, 1_000_000_000)
            # Create the messages first, so that all arrive at once: a node that waits for several is woken up once.
            if self._steps % per_clock == 0:
                self._tell_scene()
            for topics in self._robots.values():
                moves = self._steps % (self._steps_per_odom if topics.is_busy else self._steps_per_rest) == 0
                if moves or topics.has_messages:
                    messages += topics.messages(self.world.time, stamp, moves=moves)
        for event in events:  # without the lock: commands wait for it
            self.runtime.node.get_logger().warning(event)
        if messages or is_single or self._steps % per_clock == 0:
            # Publish the clock first, so that no message is from the future.
            self._clock.publish(self._clock_bytes.filled(*stamp))
        for _, send, message in messages:
            with contextlib.suppress(InvalidHandle):  # the robot was removed at this moment
                send(message)
        return True

    def _close(self) -> None:
        self.pacer.stop()
        self._thread.join(1.0)


# Computations that a robot waits for: goals of Nav2's actions whose servers plan or drive.
#
# A world that runs as fast as possible would be a minute older when a plan is ready, and on a busy machine the time
# limit of a motion would pass before its first command. Each action server publishes the status of its goals, so this
# works with Nav2's own servers, too.

COMPUTING: Final = (
    names.COMPUTE_PATH_TO_POSE,
    names.COMPUTE_PATH_THROUGH_POSES,
    names.SMOOTH_PATH,
    names.COMPUTE_ROUTE,
    names.FOLLOW_PATH,
    names.SPIN,
    names.BACKUP,
    names.DRIVE_ON_HEADING,
)
"""Actions whose goals take no simulated time, and actions that drive a robot, which take none before the first
command."""

_WORKING: Final = (GoalStatus.STATUS_ACCEPTED, GoalStatus.STATUS_EXECUTING)


class Computations:
    """A watch that reports computations to the pacer. Executor thread only."""

    def __init__(self, runtime: NodeRuntime, pacer: Pacer) -> None:
        self._node = runtime.node
        self._pacer = pacer
        self._subscriptions: dict[str, list[Any]] = {}

    def watch(self, namespaces: Set[str]) -> None:
        """Watch the servers in these namespaces ('' or 'robot1/') only."""
        for namespace in self._subscriptions.keys() - namespaces:
            for action in COMPUTING:
                self._pacer.set_computing(f'{namespace}{action}', False)
            for subscription in self._subscriptions.pop(namespace):
                self._node.destroy_subscription(subscription)
        qos = QoSProfile(depth=1, durability=QoSDurabilityPolicy.TRANSIENT_LOCAL)
        for namespace in namespaces - self._subscriptions.keys():
            self._subscriptions[namespace] = [
                self._node.create_subscription(
                    GoalStatusArray,
                    f'{action}/_action/status',
                    partial(self._tell, action),
                    qos,
                    event_callbacks=SubscriptionEventCallbacks(matched=partial(self._tell_matched, action)),
                )
                for action in (f'{namespace}{name}' for name in COMPUTING)
            ]

    def _tell_matched(self, action: str, event: Any) -> None:
        if not event.current_count:  # the server is gone, with its goals
            self._pacer.set_computing(action, False)

    def _tell(self, action: str, message: Any) -> None:
        self._pacer.set_computing(action, any(one.status in _WORKING for one in message.status_list))
