# SPDX-License-Identifier: BSD-3-Clause
"""A running demonstration: its processes, and a node that watches them as an operator's station does."""

from __future__ import annotations

import contextlib
import os
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from flexbt_common import discovery
from flexbt_common.runtime.node_runtime import NodeRuntime
from flexbt_console.commands.command_builder import CommandBuilder
from flexbt_console.link.operator_link import ExecutiveLink
from flexbt_console.mirror.mirror import Change, Mirror
from flexbt_console.mirror.records import ExecutiveSnapshot, ExecutiveState, LogLine, LogSeverity

from .demo_processes import Process
from .process_group import ProcessGroup
from .report import Timeline
from .robot_track import RobotTrack, subscribe_to_robot
from .scripted_operator import ScriptedOperator

# From the start of the first process until the demonstration is ready, in seconds of wall time.
READY_TIMEOUT_S = 180.0


@dataclass(frozen=True)
class DemoSession:
    """A ready demonstration, and an operator at its link, on a separate node."""

    operator: ScriptedOperator
    track: RobotTrack
    runtime: NodeRuntime


def set_environment() -> None:
    """Have the processes find each other quickly, and on this computer only, unless the user has it otherwise.

    Raises OSError when they cannot, see :func:`check_loopback`.
    """
    if not os.environ.get(discovery.RANGE) and not os.environ.get(discovery.PROFILE):
        discovery.only_this_computer()
    discovery.check_loopback()
    # The arithmetic of the processes is small; threads of it would only take the cores from each other.
    os.environ.setdefault('OMP_NUM_THREADS', '1')


@contextlib.contextmanager
def open_session(
    group: ProcessGroup, processes: Sequence[Process], operator: str, timeline: Timeline, *, is_on_call: bool = False
) -> Iterator[DemoSession]:
    """Start processes in `group`, wait until all of them are ready, and watch them for the time of the context.

    Raises DemoError when they are not ready in time or one of them dies meanwhile. ``is_on_call`` as for
    :func:`join_robot`.
    """
    for process in processes:
        group.start(process.name, process.command(), respawn=True)
    with join_robot(operator, timeline, is_on_call=is_on_call) as session:
        group.watch(lambda ended: session.operator.abandon(ended.report()))
        session.operator.wait_ready(peers=len(processes) - 1, timeout=READY_TIMEOUT_S)
        yield session


@contextlib.contextmanager
def join_robot(
    operator: str, timeline: Timeline, namespace: str | None = None, *, is_on_call: bool = False
) -> Iterator[DemoSession]:
    """Sit down at the link of the robot in a namespace, and watch the robot, for the time of the context.

    ``is_on_call``: another program starts the behaviors, so that the end of one is expected.
    """
    with NodeRuntime.open('demo', namespace=namespace) as runtime:
        track = RobotTrack()
        subscribe_to_robot(runtime, track)  # first: what a tree has done is handled before what came of it
        mirror = Mirror(runtime.steady)
        link = ExecutiveLink(runtime, mirror)
        scripted = ScriptedOperator(mirror, track, link.send, CommandBuilder(operator), timeline, is_on_call)
        track.on_change = scripted.notify
        mirror.add_listener(Narrator(mirror, timeline))
        yield DemoSession(scripted, track, runtime)


class Narrator:
    """A narrator that reports the events of the mirror to the timeline: states, log lines of the behavior, peers that
    appear and disappear."""

    def __init__(self, mirror: Mirror, timeline: Timeline) -> None:
        self._mirror = mirror
        self._timeline = timeline
        self._active: tuple[str, ...] = ()
        self._alive: dict[str, bool] = {}
        self._told: tuple[str, int] = ('', 0)

    def __call__(self, change: Change) -> None:
        """Inspect what changed; called on the thread that brought it."""
        if change is Change.LOG:
            for line in self._mirror.log():
                self._tell_line(line)
        elif change is Change.STATUS:
            snapshot = self._mirror.view().snapshot
            if snapshot is not None:
                self._tell_snapshot(snapshot)

    def _tell_line(self, line: LogLine) -> None:
        if line.executive_id == self._told[0] and line.sequence <= self._told[1]:
            return
        self._told = (line.executive_id, line.sequence)
        if line.severity >= LogSeverity.INFO:
            where = f'{line.path}: ' if line.path else ''
            mark = f'{line.severity.name.lower()}: ' if line.severity >= LogSeverity.WARN else ''
            self._timeline.tell('log', f'{where}{mark}{line.text}')

    def _tell_snapshot(self, snapshot: ExecutiveSnapshot) -> None:
        active = tuple(state.path for state in snapshot.active_states)
        if active != self._active:
            self._active = active
            running = snapshot.state is not ExecutiveState.IDLE
            self._timeline.tell('state', ', '.join(active) or ('(between states)' if running else '(idle)'))
        for peer in snapshot.peers:
            if self._alive.get(peer.name) and not peer.alive:
                self._timeline.tell('peer', f'{peer.name} died')
            self._alive[peer.name] = peer.alive
