# SPDX-License-Identifier: BSD-3-Clause
"""A robot as the mirror sees it, and the server of its page at a port of this computer."""

from __future__ import annotations

import asyncio
import contextlib
import dataclasses
import threading
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any

from flexbt_console.commands.command_builder import CommandBuilder
from flexbt_console.link.fleet_link import FleetLink
from flexbt_console.link.robot_link import RobotLink
from flexbt_console.mirror.command_tracker import CommandState
from flexbt_console.mirror.fleet import Fleet
from flexbt_console.mirror.mirror import Mirror
from flexbt_console.mirror.records import (
    ActiveState,
    Behavior,
    BehaviorList,
    BehaviorParameter,
    CommandKind,
    CommandResult,
    Decision,
    DecisionKind,
    ExecutiveSnapshot,
    ExecutiveState,
    FramedPose,
    GridMap,
    LogLine,
    LogSeverity,
    OperatorCommand,
    ResultCode,
    StateKind,
    StateStructure,
    Structure,
    UserdataScope,
)
from flexbt_console.mirror.trees import (
    MirroredNode,
    MirroredNodeKind,
    MirroredStatus,
    StatusChange,
    TreeNodes,
    TreeReport,
)
from flexbt_console.ui.station import Attention, Station
from flexbt_console.ui.web.access import Access
from flexbt_console.ui.web.requests import LEAVING
from flexbt_console.ui.web.server import WebServer, serving
from flexbt_core.clock.clock import ManualClock

NASTY = '<img src=x onerror=alert(1)>'
PLAN = Decision('d1', DecisionKind.TRANSITION, '/Drive', 'done', ('done', 'failed'), 2, prompt=NASTY)
OTHER = dataclasses.replace(PLAN, id='d2', outcome='failed', prompt='other')
WHERE = Decision('d4', DecisionKind.INPUT, '/Ask', input_type='geometry_msgs/msg/PoseStamped', prompt='Where to?')
STRUCTURE = Structure(
    'r1',
    'Patrol',
    (
        StateStructure('/', StateKind.MACHINE, 'Patrol', ('Drive', 'Ask'), ('finished',)),
        StateStructure('/Drive', StateKind.STATE, 'BtExecute', (), ('done', 'failed'), ('/Ask', '=finished'), (2, -1)),
        StateStructure('/Ask', StateKind.STATE, 'Input', (), ('received',), ('/Drive',), (0,)),
    ),
)


class WebRobot(RobotLink):
    """An executive as the mirror sees it; it applies what it is sent when ``answers``.

    With ``is_drawn`` there is a machine and a tree, of which the server has pictures made, which takes seconds.
    """

    def __init__(self, *, answers: bool = True, is_drawn: bool = False) -> None:
        self.clock = ManualClock()
        self.mirror = Mirror(self.clock, {'kitchen': FramedPose(3.0, 1.0)})
        self.sent: list[OperatorCommand] = []
        self.arrived = threading.Condition()
        self.answers = answers
        self.snapshot = ExecutiveSnapshot(
            'e',
            0,
            state=ExecutiveState.RUNNING,
            run_id='r1',
            behavior='Patrol',
            autonomy=1,
            active_states=(ActiveState('/Drive', 1.0, (f'follows {NASTY}',)),),
            robot_pose=FramedPose(2.0, 2.0, 0.0),
            stamp=5.0,
        )
        parameters = (BehaviorParameter('speed', 'float', '0.3'), BehaviorParameter('room', choices=('a', 'b')))
        self.mirror.receive_behaviors(BehaviorList('e', (Behavior('Patrol', parameters=parameters),)))
        self.mirror.receive_log(LogLine('e', 1, LogSeverity.WARN, NASTY, '/Drive', 'r1', 4.0))
        walls = bytes(100 if x in (0, 79) or y in (0, 59) else 0 for y in range(60) for x in range(80))
        self.mirror.receive_map(GridMap(80, 60, 0.05, 0.0, 0.0, walls))
        self.mirror.receive_plan(((2.0, 2.0), (3.0, 1.0)))
        if is_drawn:
            self._begin()
        self.show()
        self.show()

    def _begin(self) -> None:
        self.mirror.receive_structure(STRUCTURE)
        self.begin_tree('t', 'Drive')

    def begin_tree(self, run: str, tree: str) -> None:
        """Publish a tree that runs."""
        self.tree_run = run
        nodes = [
            MirroredNode(1, 0, 'Main', 'Sequence'),
            MirroredNode(2, 1, NASTY, 'FollowPath'),
            MirroredNode(3, 1, 'Wait', 'Wait', kind=MirroredNodeKind.ACTION),
            MirroredNode(4, 1, 'IsFar', 'IsFar', kind=MirroredNodeKind.CONDITION),
        ]
        self.mirror.receive_tree_structure(TreeNodes(run, tree, nodes, 1.0))
        statuses = [MirroredStatus.RUNNING, MirroredStatus.SUCCESS, MirroredStatus.RUNNING]
        changes = [StatusChange(2.0, uid + 1, status) for uid, status in enumerate(statuses)]
        self.mirror.receive_tree_status(TreeReport(run, 1, statuses, changes, 5.0, finished=False, paused=False))

    def end_tree(self) -> None:
        """Note that it has ended."""
        self.mirror.receive_tree_status(TreeReport(self.tree_run, 2, [], [], 6.0, finished=True, paused=False))

    def show(self, *decisions: Decision, **parts: Any) -> None:
        """Publish that this decision waits, and what else is given."""
        changed = {'sequence': self.snapshot.sequence + 1, 'decisions': decisions, **parts}
        self.snapshot = dataclasses.replace(self.snapshot, **changed)
        self.mirror.receive_snapshot(self.snapshot)

    def send(self, command: OperatorCommand, timeout: float, label: str) -> object:
        """See :class:`RobotLink`."""
        tracked = self.mirror.give(command, timeout, label)
        if tracked.state is CommandState.REFUSED:
            return tracked
        with self.arrived:
            self.sent.append(command)
            self.arrived.notify_all()
        if self.answers:
            self.show(results=(CommandResult(command.id, ResultCode.APPLIED),))
        return tracked

    def userdata(self, path: str, keys: Sequence[str], timeout: float) -> tuple[UserdataScope, ...]:
        """See :class:`RobotLink`."""
        return ()

    def wait_sent(self, count: int, timeout: float = 60.0) -> list[OperatorCommand]:
        """Wait until so many commands have come."""
        with self.arrived:
            assert self.arrived.wait_for(lambda: len(self.sent) >= count, timeout), self.sent
            return list(self.sent)

    @property
    def kinds(self) -> list[CommandKind]:
        """The kinds of what has come."""
        return [command.kind for command in self.sent]

    def station(self, obstacles: Any = None) -> Station:
        """Return what its page needs."""
        attention = Attention(self.clock)
        return Station(self.mirror, self, CommandBuilder('ann'), 5.0, attention, LEAVING, obstacles=obstacles)


class WebRobots(FleetLink):
    """Robots by their names, as the page finds them; ``opened`` are those of which somebody sees what is around."""

    def __init__(self, stations: Mapping[str, Station]) -> None:
        self.fleet = Fleet()
        self.own = next(iter(stations), '/')
        self.opened: list[str] = []
        self.present: list[tuple[str, str]] = []
        self.stations: dict[str, Station] = {}
        for name, station in stations.items():
            self.come(name, station)

    def come(self, name: str, station: Station) -> None:
        """Note that it is found."""
        self.stations[name] = station
        self.fleet.add(name, station.mirror)

    def robot(self, name: str) -> tuple[Mirror, Any]:
        """See :class:`FleetLink`."""
        station = self.stations.get(name)
        return (station.mirror, station.link) if station else (Mirror(ManualClock()), WebRobot())

    def open(self, name: str, operator: str = '') -> None:
        """See :class:`FleetLink`."""
        self.opened.append(name)
        self.present.append((name, operator))

    def close(self, name: str, operator: str = '') -> None:
        """See :class:`FleetLink`."""
        self.opened.remove(name)
        self.present.remove((name, operator))

    def station(self, mirror: Mirror, link: RobotLink, operator: str) -> Station:
        """Return what the page of one needs."""
        known = (one for one in self.stations.values() if one.mirror is mirror)
        if operator:
            known = (dataclasses.replace(one, builder=CommandBuilder(operator)) for one in known)
        return next(known, Station(mirror, link, CommandBuilder('ann'), 5.0, Attention(ManualClock()), LEAVING))


@contextlib.contextmanager
def served(
    stations: Mapping[str, Station] | WebRobots,
    access: Access | None = None,
    port: int = 0,
    operator: Callable[[str], str] | None = None,
) -> Iterator[int]:
    """Provide the server of these robots on a thread of its own, for the time of the context; gives its port."""
    loop = asyncio.new_event_loop()
    thread = threading.Thread(target=loop.run_forever, daemon=True)
    thread.start()

    robots = stations if isinstance(stations, WebRobots) else WebRobots(stations)
    serves = serving(WebServer(robots, robots.station, access or Access(), operator).application(), '127.0.0.1', port)
    used = asyncio.run_coroutine_threadsafe(serves.__aenter__(), loop).result(60.0)
    try:
        yield used
    finally:
        asyncio.run_coroutine_threadsafe(serves.__aexit__(None, None, None), loop).result(60.0)
        loop.call_soon_threadsafe(loop.stop)
        thread.join()
        loop.close()
