# SPDX-License-Identifier: BSD-3-Clause
"""Whether the memory of a console stays flat: hours of traffic at its mirror, in fast motion, with a screen or a page.

Statuses twice a second, with a pose that moves and a decision now and then; runs that begin and end, each with its
machine, its trees and their statuses; transitions, a log that never ends, scans, plans, a map now and then; commands
of the operator, and their answers; the executive is started again each hour. A screen draws every so many seconds of
simulated time, or a page waits for what its server tells then. Prints the resident memory after each hour, in MB:
after the second it should not grow.

Usage: python3 benchmarks console_memory [--hours H] [--look S] [--output FILE.json]
"""

from __future__ import annotations

import argparse
import asyncio
import gc
import json
import math
import multiprocessing
import sys
from collections.abc import Awaitable, Callable, Iterator
from pathlib import Path
from typing import Any

from _figures import write_figures
from aiohttp import ClientSession

from flexbt_console.commands.command_builder import CommandBuilder
from flexbt_console.link.fleet_link import FleetLink
from flexbt_console.link.robot_link import RobotLink
from flexbt_console.mirror.fleet import Fleet
from flexbt_console.mirror.mirror import Mirror
from flexbt_console.mirror.records import (
    ActiveState,
    CommandKind,
    CommandResult,
    Decision,
    DecisionKind,
    EventKind,
    ExecutiveEvent,
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
)
from flexbt_console.mirror.trees import MirroredNode, MirroredStatus, StatusChange, TreeNodes, TreeReport
from flexbt_console.ui.screen.app import OperatorScreen
from flexbt_console.ui.station import Attention, Station
from flexbt_console.ui.web.access import Access
from flexbt_console.ui.web.requests import LEAVING
from flexbt_console.ui.web.server import WebServer, serving
from flexbt_core.clock.clock import ManualClock

STEP = 0.5
"""Simulated seconds from one status to the next."""

RUN_SECONDS = 60.0
NODES = 40
MAP_SECONDS = 600.0


class Robot(RobotLink):
    """An executive as its mirror hears it; it is a link, too: it applies what it is sent."""

    def __init__(self) -> None:
        self.clock = ManualClock()
        self.mirror = Mirror(self.clock)
        self.make = CommandBuilder('ann')
        self.results: tuple[CommandResult, ...] = ()
        self.sequence = 0
        self._step = 0

    def send(self, command: OperatorCommand, timeout: float, label: str) -> object:
        """Take a command, which is answered with the next status."""
        tracked = self.mirror.give(command, timeout, label)
        self.results = (*self.results[-7:], CommandResult(command.id, ResultCode.APPLIED))
        return tracked

    def step(self) -> None:
        """Return what is heard in half a second."""
        self._step += 1
        self.sequence += 1
        self.clock.advance(STEP)
        now = self._step * STEP
        executive, run = f'e{int(now // 3600)}', f'r{int(now // RUN_SECONDS)}'
        if now % RUN_SECONDS < STEP:
            self._begin(executive, run, now)
        state = f'/State{int(now % 50)}'
        pose = FramedPose(5.0 + 4.0 * math.cos(now / 10.0), 5.0 + 4.0 * math.sin(now / 7.0), now % 3.0)
        waits = now % 20.0 < 3.0
        decision = Decision(f'd{int(now // 20)}', DecisionKind.TRANSITION, state, 'done', ('done',), 2, prompt='so?')
        self.mirror.receive_snapshot(
            ExecutiveSnapshot(
                executive,
                self.sequence,
                state=ExecutiveState.RUNNING,
                run_id=run,
                behavior='Endurance',
                active_states=(ActiveState(state, now, ('drives',), tree_run_id=f't{run}'),),
                decisions=(decision,) if waits else (),
                results=self.results,
                robot_pose=pose,
                stamp=now,
            )
        )
        statuses = [MirroredStatus(1 + (uid + self._step) % 3) for uid in range(NODES)]
        changes = [StatusChange(now, uid + 1, status) for uid, status in enumerate(statuses)]
        ends = now % RUN_SECONDS >= RUN_SECONDS - STEP
        report = TreeReport(f't{run}', self.sequence, statuses, changes, now, finished=ends, paused=False)
        self.mirror.receive_tree_status(report)
        text = f'line {self.sequence} of a log that does not end'
        self.mirror.receive_log(LogLine(executive, self.sequence, LogSeverity.INFO, text, state, run, now))
        kind = EventKind.TRANSITION
        self.mirror.receive_events([ExecutiveEvent(executive, self.sequence, kind, path=state, run_id=run, stamp=now)])
        around = [math.tau * number / 360 for number in range(360)]
        reach = 2.0 + math.sin(now)
        scan = tuple((pose.x + reach * math.cos(angle), pose.y + reach * math.sin(angle)) for angle in around)
        self.mirror.receive_scan(scan, 3.0)
        self.mirror.receive_plan(tuple((pose.x + number * 0.05, pose.y) for number in range(200)))
        if waits and now % 20.0 < STEP:
            answer = OperatorCommand(
                f'c{self.sequence}', CommandKind.CONFIRM, 'ann', executive, run, decision.id, outcome='done'
            )
            self.send(answer, 5.0, 'confirm')
            self.mirror.due_commands(True)

    def _begin(self, executive: str, run: str, now: float) -> None:
        paths = ['/', *(f'/State{number}' for number in range(50))]
        kinds = [StateKind.MACHINE, *([StateKind.STATE] * 50)]
        states = [
            StateStructure(path, kind, 'State', (), ('done',), ('/State0',))
            for path, kind in zip(paths, kinds, strict=True)
        ]
        self.mirror.receive_structure(Structure(run, f'Endurance {run}', tuple(states)))
        nodes = [MirroredNode(uid, uid // 2, f'node {uid}', 'Sequence') for uid in range(1, NODES + 1)]
        self.mirror.receive_tree_structure(TreeNodes(f't{run}', f'Tree {run}', nodes, now))
        if now % MAP_SECONDS < RUN_SECONDS:
            self.mirror.receive_map(GridMap(200, 200, 0.05, 0.0, 0.0, bytes([int(now) % 100]) * 40_000))


class Robots(FleetLink):
    """The one robot, as the server of the page finds it."""

    def __init__(self, robot: Robot) -> None:
        self.fleet = Fleet()
        self.own = '/'
        self._robot = robot
        self.fleet.add('/', robot.mirror)

    def robot(self, name: str) -> tuple[Mirror, Any]:
        """Return the robot."""
        return self._robot.mirror, self._robot

    def open(self, name: str, operator: str = '') -> None:
        """Measure with it open."""

    def close(self, name: str, operator: str = '') -> None:
        """Keep it open."""


def resident() -> float:
    """Resident memory of this process, MB."""
    gc.collect()
    pages = int(Path('/proc/self/statm').read_text().split()[1])
    return round(pages * 4096 / 1e6, 1)


def hours(robot: Robot, count: int, look: int) -> Iterator[int]:
    """Live so many hours; gives the simulated second at every ``look`` seconds."""
    for step in range(int(count * 3600 / STEP)):
        robot.step()
        if step % int(look / STEP) == 0:
            yield int(step * STEP)


async def with_screen(robot: Robot, count: int, look: int, note: Callable[[int], None]) -> None:
    """Open a screen at the mirror."""
    robot.step()
    station = Station(robot.mirror, robot, robot.make, 5.0, Attention(robot.clock), 'it ends')
    screen: Any = OperatorScreen(station, robot.clock)
    async with screen.run_test(size=(120, 36)) as pilot:
        for second in hours(robot, count, look):
            screen.draw()
            await pilot.pause()
            note(second)


async def with_page(robot: Robot, count: int, look: int, note: Callable[[int], None]) -> None:
    """Open a page at the server."""
    robot.step()
    access, attention = Access(), Attention(ManualClock())

    def station(mirror: Mirror, link: Any, operator: str) -> Station:
        return Station(mirror, link, robot.make, 5.0, attention, LEAVING)

    server = WebServer(Robots(robot), station, access)
    async with serving(server.application(), access.address, 0) as port, ClientSession() as session:
        address = f'http://{access.address}:{port}/link'
        async with session.ws_connect(address, max_msg_size=0) as socket:
            await socket.send_json({'hello': None})
            heard = 0

            async def hear() -> None:
                nonlocal heard
                async for _ in socket:
                    heard += 1

            hearing = asyncio.create_task(hear())
            for second in hours(robot, count, look):
                before = heard
                while heard == before:  # the period of the page is of wall time
                    await asyncio.sleep(0.005)
                note(second)
            hearing.cancel()


def measure(kind: str, count: int, look: int, result: Any) -> None:
    """In a process of its own."""
    robot, figures = Robot(), []

    def note(second: int) -> None:
        if second % 3600 == 0:
            figures.append(resident())
            print(f'{kind}: after {second // 3600} h {figures[-1]} MB', flush=True)

    subject: dict[str, Callable[..., Awaitable[None]]] = {'screen': with_screen, 'page': with_page}
    asyncio.run(subject[kind](robot, count, look, note))  # type: ignore[arg-type]
    figures.append(resident())
    print(f'{kind}: after {count} h {figures[-1]} MB', flush=True)
    result.put(figures)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('--hours', type=int, default=8, help='simulated')
    parser.add_argument('--look', type=int, default=20, help='simulated seconds from one look to the next, of 3600')
    parser.add_argument('--output', type=Path, default=Path('out/console_memory.json'))
    arguments = parser.parse_args()
    context, figures = multiprocessing.get_context('spawn'), {}
    for kind in ('screen', 'page'):
        result = context.Queue()
        process = context.Process(target=measure, args=(kind, arguments.hours, arguments.look, result))
        process.start()
        figures[kind] = result.get()
        process.join()
    print(json.dumps(figures, indent=2))
    write_figures(arguments.output, figures)
    return 0


if __name__ == '__main__':
    sys.exit(main())
