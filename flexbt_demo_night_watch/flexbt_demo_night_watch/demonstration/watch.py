# SPDX-License-Identifier: BSD-3-Clause
"""A running night watch: the processes, an operator at the link of each robot, and the building."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass

from flexbt_common.runtime import NodeRuntime
from flexbt_console.mirror import AutonomyLevel
from flexbt_demo_behaviors.demonstration import (
    READY_TIMEOUT_S,
    EndedProcess,
    ProcessGroup,
    RobotTrack,
    ScriptedOperator,
    Session,
    Timeline,
    join_robot,
)

from .building import Building
from .watch_processes import ROBOTS, log_name, robot_processes, watch_processes

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
    sessions: Mapping[str, Session]
    timeline: Timeline

    def operator(self, robot: str) -> ScriptedOperator:
        """The operator at the link of a robot."""
        return self.sessions[robot].operator

    def track(self, robot: str) -> RobotTrack:
        """Where a robot is and was."""
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
        """A process has ended untold: who follows a script waits for nothing any more."""
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
