# SPDX-License-Identifier: BSD-3-Clause
"""A simulator, navigation servers and a client, as real nodes in this process."""

from __future__ import annotations

import contextlib
import math
import threading
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from itertools import pairwise, takewhile
from typing import Any, NamedTuple, TypeVar

from geometry_msgs.msg import PoseStamped, PoseWithCovarianceStamped, Twist
from nav_msgs.msg import Path
from rcl_interfaces.srv import SetParameters
from rclpy.parameter import Parameter
from rclpy.qos import QoSProfile
from rclpy.time import Time

from flexbt_common import names
from flexbt_common.calls.action_call import ActionLinks, GoalStatus
from flexbt_common.calls.service_call import ServiceLinks, service_outcome
from flexbt_common.middleware.received_messages import Received, ReceivedMessages
from flexbt_common.runtime.node_runtime import NodeRuntime
from flexbt_navigation.node import Navigation
from flexbt_sim.messages import pose_of
from flexbt_sim.simulator.node import Simulator
from flexbt_testing.waiting import DEADLINE, MESSAGE_BYTES

from .clients import ACTIONS, SentGoal

T = TypeVar('T')

DOCK = (0.8, 4.45, 0.0)
"""Start pose of the robot: at the west end of the corridor, facing along it."""

OFFICE = (3.8, 1.2, -1.57)


class Sighting(NamedTuple):
    """The pose of the robot at a time: time in s, x and y in m, heading."""

    time: float
    x: float
    y: float
    yaw: float

    def distance(self, place: Sequence[float]) -> float:
        """Return the distance to a place (x, y, ...), m."""
        return math.hypot(place[0] - self.x, place[1] - self.y)


def pose(place: Sequence[float], frame: str = 'map') -> PoseStamped:
    """Return a message for a place (x, y) or (x, y, yaw)."""
    x, y, yaw = (*map(float, place), 0.0)[:3]
    stamped = PoseStamped()
    stamped.header.frame_id = frame
    stamped.pose.position.x, stamped.pose.position.y = x, y
    stamped.pose.orientation.z, stamped.pose.orientation.w = math.sin(yaw / 2.0), math.cos(yaw / 2.0)
    return stamped


def line(start: Sequence[float], end: Sequence[float], frame: str = 'map', spacing: float = 0.05) -> Path:
    """Return a straight path; ``spacing`` is in m."""
    count = max(1, math.ceil(math.dist(start[:2], end[:2]) / spacing))
    yaw = math.atan2(end[1] - start[1], end[0] - start[0])
    path = Path()
    path.header.frame_id = frame
    path.poses = [
        pose((start[0] + (end[0] - start[0]) * i / count, start[1] + (end[1] - start[1]) * i / count, yaw), frame)
        for i in range(count + 1)
    ]
    return path


class RobotProbe:
    """A probe that observes the robot, sends it goals and commands, and moves it."""

    def __init__(self, runtime: NodeRuntime, *, hears_commands: bool = True) -> None:
        self.runtime = runtime
        self.links = ActionLinks(runtime)
        self.services = ServiceLinks(runtime)
        self._seen = threading.Event()
        self.sightings: list[Sighting] = []
        self.commands: list[tuple[float, float]] = []

        def connect() -> None:
            node = runtime.node
            # Process all waiting messages at once; otherwise observations would be seconds old on a busy machine.
            qos = QoSProfile(depth=100)
            self._poses = ReceivedMessages(node, PoseStamped, names.POSE, qos, self._on_pose, MESSAGE_BYTES)
            if hears_commands:
                ReceivedMessages(node, Twist, names.CMD_VEL, qos, self._on_command, MESSAGE_BYTES)
            self._drive = node.create_publisher(Twist, names.CMD_VEL, 1)
            self._places = node.create_publisher(PoseWithCovarianceStamped, names.INITIAL_POSE, 1)

        runtime.call(connect)

    def _on_pose(self, received: Received) -> None:
        message: PoseStamped = received.unpack(PoseStamped)
        x, y, yaw = pose_of(message.pose)
        self.sightings.append(Sighting(Time.from_msg(message.header.stamp).nanoseconds * 1e-9, x, y, yaw))
        self._seen.set()

    def _on_command(self, received: Received) -> None:
        message: Twist = received.unpack(Twist)
        self.commands.append((message.linear.x, message.angular.z))
        self._seen.set()

    def wait(self, condition: Callable[[], T], what: str, timeout: float = DEADLINE) -> T:
        """Return the first true value of a condition, checked at each observation and now and then."""
        end = time.monotonic() + timeout
        self._seen.clear()
        while not (value := condition()):
            assert time.monotonic() < end, f'{what}: not within {timeout:g} s; last seen: {self.sightings[-1:]}'
            self._seen.wait(0.02)
            self._seen.clear()  # before the next check, so that later events are not missed
        return value

    @property
    def now(self) -> Sighting:
        """Return the newest sighting of all received so far, so that an earlier rest is not taken for a later one."""
        self.runtime.call(self._poses.take)
        self.wait(lambda: self.sightings, 'a pose of the robot')
        return self.sightings[-1]

    def later(self, seconds: float) -> Sighting:
        """Wait for this much simulated time, and return the robot's pose."""
        until = self.now.time + seconds
        self.wait(lambda: self.sightings[-1].time >= until, f'{seconds:g} s of simulated time')
        return self.sightings[-1]

    def moving(self, seconds: float = 0.1) -> bool:
        """Return whether the robot has moved in the last ``seconds`` of its observed poses."""
        last = self.sightings[-1]
        recent = [seen for seen in self.sightings[-200:] if seen.time >= last.time - seconds - 0.02]
        return any(seen.distance(last[1:]) > 1e-6 or abs(seen.yaw - last.yaw) > 1e-6 for seen in recent)

    def wait_at_rest(self) -> Sighting:
        """Wait until the robot has stood still for 0.3 s, and return the first sighting of that rest."""
        since = self.now.time + 0.3
        self.wait(lambda: self.sightings[-1].time > since and not self.moving(0.3), 'the robot at rest')
        last = self.sightings[-1]
        return list(takewhile(lambda seen: seen[1:] == last[1:], reversed(self.sightings)))[-1]

    def wait_driving(self, speed: float = 0.2) -> Sighting:
        """Return the first sighting, from now on, with the robot at this speed, m/s."""
        seen = len(self.sightings)
        self.wait(lambda: any(v >= speed for v in self.speeds(self.sightings[seen:])), f'{speed:g} m/s')
        return self.now

    @staticmethod
    def speeds(sightings: Sequence[Sighting]) -> list[float]:
        """Return the speed from each sighting to the next, m/s."""
        return [here.distance(ahead[1:]) / (ahead.time - here.time) for here, ahead in pairwise(sightings)]

    def set_speed_factor(self, factor: float) -> None:
        """Set the speed of simulated time."""
        change = Parameter('speed_factor', value=factor).to_parameter_msg()
        response = self.ask(SetParameters, 'simulator/set_parameters', SetParameters.Request(parameters=[change]))
        assert response.results[0].successful, response.results[0].reason

    def drive(self, linear: float, angular: float = 0.0) -> None:
        """Send one velocity command."""
        command = Twist()
        command.linear.x, command.angular.z = float(linear), float(angular)
        self._drive.publish(command)

    def put(self, place: Sequence[float], frame: str = 'map') -> None:
        """Send a place for the robot, once."""
        stamped = pose(place, frame)
        message = PoseWithCovarianceStamped(header=stamped.header)
        message.pose.pose = stamped.pose
        self._places.publish(message)

    def place(self, place: Sequence[float]) -> Sighting:
        """Put the robot somewhere, at rest, and return the first sighting there."""
        self.wait(lambda: self._places.get_subscription_count(), 'the simulator')
        seen = len(self.sightings)
        self.put(place)
        yaw = (*place, 0.0)[2]  # it may have been there already, with another heading

        def is_there(one: Sighting) -> bool:
            return one.distance(place) < 1e-6 and abs(math.remainder(one.yaw - yaw, math.tau)) < 1e-6

        self.wait(lambda: any(map(is_there, self.sightings[seen:])), f'the robot at {place}')
        return self.wait_at_rest()

    def send(self, action: str, **fields: Any) -> SentGoal:
        """Send a goal of a navigation action."""
        return SentGoal(self.links.link(ACTIONS[action], action), ACTIONS[action].Goal(**fields), DEADLINE)

    def plan(self, goal: Sequence[float], **fields: Any) -> SentGoal:
        """Request a path to a place."""
        return self.send(names.COMPUTE_PATH_TO_POSE, goal=pose(goal), **fields)

    def follow(self, path: Path, **fields: Any) -> SentGoal:
        """Send a path to follow."""
        return self.send(names.FOLLOW_PATH, path=path, **fields)

    def ask(self, service_type: Any, name: str, request: Any) -> Any:
        """Call a service and return the response."""
        outcome = service_outcome(self.services.link(service_type, name), request, DEADLINE)
        assert outcome.ok, outcome.reason
        return outcome.response


def aborted(goal: SentGoal, code: int) -> Any:
    """Return the result of a goal that must be aborted with this error code."""
    assert goal.wait().status is GoalStatus.ABORTED, goal.wait()
    assert goal.result.error_code == code, goal.result.error_msg
    return goal.result


@contextlib.contextmanager
def without_faults(name: str, **settings: Any) -> Iterator[NodeRuntime]:
    """Provide a runtime. At the end, check that no callback has let an exception escape."""
    faults: list[BaseException] = []
    with NodeRuntime.open(name, **settings) as runtime:
        runtime.on_fault(faults.append)
        yield runtime
    assert faults == []


@contextlib.contextmanager
def open_probe() -> Iterator[RobotProbe]:
    """Provide a probe, before a simulator exists."""
    with without_faults('probe') as runtime:
        yield RobotProbe(runtime)


@contextlib.contextmanager
def open_simulator(**parameters: Any) -> Iterator[RobotProbe]:
    """Provide a simulator and its probe."""
    with without_faults(names.SIMULATOR, parameters=parameters) as simulator, open_probe() as probe:
        Simulator(simulator)
        probe.wait(lambda: probe.sightings, 'a pose of the robot')
        yield probe


@contextlib.contextmanager
def open_navigation(**parameters: Any) -> Iterator[NodeRuntime]:
    """Provide navigation servers on simulated time."""
    settings = {'use_sim_time': True} | parameters
    with without_faults(names.NAVIGATION, parameters=settings) as runtime:
        Navigation(runtime)
        yield runtime


FAST = {'speed_factor': 0.0}


@contextlib.contextmanager
def open_sim_world(
    simulator: Mapping[str, Any] = FAST, navigation: Mapping[str, Any] | None = None
) -> Iterator[RobotProbe]:
    """Provide a simulator, navigation servers and a probe."""
    with open_simulator(**simulator) as probe, open_navigation(**(navigation or {})):
        yield probe
