# SPDX-License-Identifier: BSD-3-Clause
"""The night watch: its processes, the one table that `night_watch` and the launch file start them from, an operator for
each robot, and what happens in the building.
"""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Final

from geometry_msgs.msg import PoseStamped
from rclpy.qos import QoSProfile
from sensor_msgs.msg import BatteryState
from std_msgs.msg import String

from flexbt_common import names
from flexbt_common.runtime.node_runtime import NodeRuntime
from flexbt_console.mirror.records import AutonomyLevel
from flexbt_demo_behaviors.demonstration.demo_processes import (
    ODOM_RATE,
    SIMULATED,
    Process,
    demo_file,
    mission_processes,
)
from flexbt_demo_behaviors.demonstration.process_group import EndedProcess, ProcessGroup
from flexbt_demo_behaviors.demonstration.report import RobotTrack, Timeline
from flexbt_demo_behaviors.demonstration.running import READY_TIMEOUT_S, DemoSession, join_robot
from flexbt_demo_behaviors.demonstration.scripted_operator import ScriptedOperator
from flexbt_demo_behaviors.demonstration.simulation import DemoSimulation
from flexbt_sim.messages import pose_of
from flexbt_sim.world import Pose

from .states import ROOMS_LEFT

ROBOTS: Final = ('alpha', 'beta')

SPEED: Final = 0.7
"""Speed on a free and straight way, m/s: the maximum speed of the robots in the world file."""


WORLD: Final = demo_file('night_watch/building.yaml')
PLACES: Final = demo_file('night_watch/places.yaml')


def watch_processes(speed: float) -> tuple[Process, ...]:
    """Return the simulator, and navigation, BT server, stop guard and executive of each robot; ``speed`` in seconds per
    second."""
    world = Process('flexbt_sim', 'simulator', {'speed_factor': speed, 'world': WORLD, 'odom_rate': ODOM_RATE})
    return (world, *(process for robot in ROBOTS for process in robot_processes(robot)))


def robot_processes(robot: str) -> tuple[Process, ...]:
    """Return what runs on one robot."""
    return (
        Process('flexbt_navigation', 'navigation', {**SIMULATED, 'desired_linear_vel': SPEED}, robot),
        *mission_processes(PLACES, namespace=robot),
    )


def log_name(process: Process) -> str:
    """Under which name a process is started, and its log file is written."""
    return f'{process.namespace}_{process.name}' if process.namespace else process.name


ROUNDS: Mapping[str, Mapping[str, str]] = {
    'alpha': {'rooms': 'lab store office', 'home': 'alpha_dock', 'partner': 'beta'},
    'beta': {'rooms': 'archive lobby', 'home': 'beta_dock', 'partner': 'alpha'},
}
"""The arguments with which the behavior of each robot is started."""


@dataclass
class Watch:
    """A ready night watch."""

    group: ProcessGroup
    building: Building
    sessions: Mapping[str, DemoSession]
    timeline: Timeline

    def operator(self, robot: str) -> ScriptedOperator:
        """Return the operator at the link of a robot."""
        return self.sessions[robot].operator

    def track(self, robot: str) -> RobotTrack:
        """Return where a robot is and was."""
        return self.sessions[robot].track

    def start(self) -> None:
        """Begin the rounds of both robots."""
        for robot in ROBOTS:
            self.operator(robot).start('Night Watch', AutonomyLevel.HIGH, **ROUNDS[robot])

    def lose(self, robot: str) -> None:
        """Let the computer of a robot die at once, with all that runs on it."""
        self.timeline.tell('building', f'{robot} is lost')
        self.group.kill(*(log_name(process) for process in robot_processes(robot)))

    def notify(self) -> None:
        """Have the operators look again at what they wait for."""
        for session in self.sessions.values():
            session.operator.notify()

    def on_end(self, ended: EndedProcess) -> None:
        """Note that a process has ended by itself: a script waits for nothing any more."""
        for session in self.sessions.values():
            session.operator.abandon(ended.report())


@contextlib.contextmanager
def open_watch(group: ProcessGroup, speed: float, timeline: Timeline) -> Iterator[Watch]:
    """Start the processes in `group`, wait until both robots are ready, and join them for the time of the context.

    Raises DemoError when they are not ready in time, or when one of the processes dies meanwhile.
    """
    for process in watch_processes(speed):
        group.start(log_name(process), process.command(), respawn=True)
    with contextlib.ExitStack() as stack:
        runtime = stack.enter_context(NodeRuntime.open('night_watch'))
        sessions = {
            robot: stack.enter_context(join_robot('watchman', timeline.of(robot), robot)) for robot in ROBOTS
        }  # fmt: skip
        building = Building(runtime, ROBOTS, timeline, lambda: watch.notify())
        watch = Watch(group, building, sessions, timeline)
        group.watch(watch.on_end)
        for robot in ROBOTS:
            watch.operator(robot).wait_ready(peers=len(robot_processes(robot)), timeout=READY_TIMEOUT_S)
        yield watch


# Events in the building during a watch, by the services of the simulator; and the robots' reports of them.

DOOR: Final = 'archive_door'

LOW: Final = 0.25
FULL: Final = 0.85
"""Shares of the capacity at which a battery counts as low, and as charged."""


class Building:
    """A building in which faults occur, and whose rooms and alarms are observed. `on_change` is called, on another
    thread, on each observation."""

    def __init__(
        self, runtime: NodeRuntime, robots: Sequence[str], timeline: Timeline, on_change: Callable[[], None]
    ) -> None:
        self._simulation = DemoSimulation(runtime, timeline)
        self._timeline = timeline
        self._on_change = on_change
        self.rooms_left: Mapping[str, tuple[str, ...]] = {}
        """The rooms that each robot has still to look at, as it said last."""
        self.alarms: list[tuple[str, Pose]] = []
        """The alarms so far: the robot that has raised each, and the pose that it is about."""
        self.charged: set[str] = set()
        """The robots whose battery was low, and is not any more."""
        self._low: set[str] = set()
        runtime.call(lambda: self._subscribe(runtime, robots))

    def lower_battery(self, robot: str) -> None:
        """Leave little in the battery of a robot."""
        self._simulation.set_fault(robot, 'battery_low', 'level: 0.1')
        self._timeline.tell('building', f'the battery of {robot} runs low')

    def mend_door(self) -> None:
        """Have the jammed door mended."""
        self._simulation.set_fault(DOOR, 'door_jammed', clear=True)
        self._timeline.tell('building', f'{DOOR} is mended')

    def _subscribe(self, runtime: NodeRuntime, robots: Sequence[str]) -> None:
        node = runtime.node
        for robot in robots:
            node.create_subscription(
                String, f'{robot}/{ROOMS_LEFT}', partial(self._on_left, robot), names.transient_local_qos()
            )
            battery = partial(self._on_battery, robot)
            node.create_subscription(BatteryState, f'{robot}/battery_state', battery, QoSProfile(depth=10))
            alarm = partial(self._on_alarm, robot)
            node.create_subscription(PoseStamped, f'{robot}/alarm', alarm, QoSProfile(depth=10))

    def _on_left(self, robot: str, message: String) -> None:
        self.rooms_left = {**self.rooms_left, robot: tuple(message.data.split())}
        self._on_change()

    def _on_battery(self, robot: str, message: BatteryState) -> None:
        if message.percentage <= LOW:
            self._low.add(robot)
        elif message.percentage >= FULL and robot in self._low:
            self.charged.add(robot)
            self._on_change()

    def _on_alarm(self, robot: str, message: PoseStamped) -> None:
        self.alarms.append((robot, pose_of(message.pose)))
        self._on_change()
