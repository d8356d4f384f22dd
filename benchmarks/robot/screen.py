#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""How long a key takes to reach the operator's screen, with robots whose statuses come in all the time.

The screen runs in this process, on a terminal of Textual's own without a display: what is measured is from the key to
the drawn screen, without the terminal. Each robot has a state machine of 12 states, a tree of 40 nodes and a map; its
status changes `--rate` times a second.

And what goes over the connection of the terminal for each status of a robot that drives.
"""

from __future__ import annotations

import argparse
import asyncio
import json
import statistics
import sys
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

from _figures import write_figures

from flexbt_console.commands.command_builder import CommandBuilder
from flexbt_console.link.fleet_link import FleetLink
from flexbt_console.link.robot_link import RobotLink
from flexbt_console.mirror.fleet import Fleet
from flexbt_console.mirror.mirror import Mirror
from flexbt_console.mirror.records import (
    ActiveState,
    Decision,
    DecisionKind,
    ExecutiveSnapshot,
    ExecutiveState,
    FramedPose,
    GridMap,
    StateKind,
    StateStructure,
    Structure,
)
from flexbt_console.mirror.trees import MirroredNode, MirroredStatus, TreeNodes, TreeReport
from flexbt_console.ui.screen.app import OperatorScreen
from flexbt_console.ui.station import Attention, Station
from flexbt_core.clock.clock import Clock, SteadyClock

KEYS = ['o', 'down', 'down', 'escape', 'question_mark', 'escape', 'z', 'z', 'z', 'z']


class Robot(RobotLink):
    """A mirror that is fed, and a link that goes nowhere."""

    def __init__(self, number: int, clock: SteadyClock) -> None:
        self.mirror = Mirror(clock)
        states = tuple(StateStructure(f'/S{n}', StateKind.STATE, 'Drive', (), ('done',), ('/S0',)) for n in range(12))
        root = StateStructure('/', StateKind.MACHINE, 'Patrol', tuple(f'S{n}' for n in range(12)), ('finished',))
        self.mirror.receive_structure(Structure('r', 'Patrol', (root, *states)))
        walls = bytes(100 if x % 40 == 0 or y % 40 == 0 else 0 for y in range(400) for x in range(400))
        self.mirror.receive_map(GridMap(400, 400, 0.05, 0.0, 0.0, walls))
        nodes = [MirroredNode(uid, uid // 2, f'N{uid}', 'Sequence') for uid in range(1, 41)]
        self.mirror.receive_tree_structure(TreeNodes('t', 'Drive', nodes, 0.0))
        report = TreeReport('t', 1, [MirroredStatus.RUNNING] * 40, [], 1.0, finished=False, paused=False)
        self.mirror.receive_tree_status(report)
        asked = (Decision('d', DecisionKind.TRANSITION, '/S1', 'done', ('done',), 2),) if number % 5 == 0 else ()
        self.snapshot = ExecutiveSnapshot(
            'e', 0, state=ExecutiveState.RUNNING, run_id='r', behavior='Patrol', decisions=asked,
            active_states=(ActiveState('/S1', 1.0, tree_run_id='t'),), robot_pose=FramedPose(1.0, 1.0), stamp=1.0,
        )  # fmt: skip

    def change(self) -> None:
        """Publish the next status: the robot drives."""
        pose = FramedPose(1.0 + self.snapshot.sequence * 0.01 % 8.0, 1.0)
        self.snapshot = replace(self.snapshot, sequence=self.snapshot.sequence + 1, robot_pose=pose)
        self.mirror.receive_snapshot(replace(self.snapshot, stamp=1.0 + self.snapshot.sequence * 0.1))

    def send(self, command: Any, timeout: float, label: str) -> None:
        """Nothing is sent."""


class TimedScreen(OperatorScreen):
    """Notes when something was first written to the screen."""

    displayed = 0.0

    def _display(self, screen: Any, renderable: Any) -> None:
        super()._display(screen, renderable)
        self.displayed = self.displayed or time.perf_counter()


class Robots(FleetLink):
    """All of them, as the screen wants them."""

    def __init__(self, count: int, clock: SteadyClock) -> None:
        self.robots = {f'/robot{number:02}': Robot(number, clock) for number in range(count)}
        self.fleet = Fleet()
        self.own = '/robot00'
        for name, robot in self.robots.items():
            self.fleet.add(name, robot.mirror)

    def select(self, name: str) -> tuple[Mirror, Any]:
        """Go to a robot."""
        return self.robots[name].mirror, self.robots[name]


async def measure(count: int, rate: float, rounds: int, size: tuple[int, int]) -> dict[str, float]:
    """Milliseconds from a key to the screen."""
    clock = SteadyClock()
    robots = Robots(count, clock)

    async def feed() -> None:
        while True:
            for robot in robots.robots.values():
                robot.change()
                await asyncio.sleep(1.0 / (rate * count))

    app = TimedScreen(station(robots, clock), clock, robots)
    times = []
    async with app.run_test(size=size) as pilot:
        feeding = asyncio.create_task(feed())
        for _ in range(rounds):
            for key in KEYS:
                app.displayed = 0.0
                begin = time.perf_counter()
                await pilot.press(key)
                app.draw()
                await pilot.pause()
                times.append((app.displayed - begin) * 1e3)
        feeding.cancel()
    taken = [one for one in times if one > 0.0]
    return {'median ms': statistics.median(taken), '95 % ms': statistics.quantiles(taken, n=20)[-1]}


def station(robots: Robots, clock: Clock) -> Station:
    """Return the robot that the screen begins with, as its operator has it."""
    mirror, robot = robots.select(robots.own)
    return Station(mirror, robot, CommandBuilder('ann'), 5.0, Attention(clock), 'stays')


async def traffic(count: int, size: tuple[int, int]) -> float:
    """Bytes to the terminal for each of so many statuses of one robot that drives."""
    clock = SteadyClock()
    robots = Robots(1, clock)
    _, robot = robots.select(robots.own)
    app = OperatorScreen(station(robots, clock), clock)
    written = 0

    def write(screen: Any, update: Any) -> None:
        nonlocal written
        written += len(update.render_segments(app.console).encode())

    async with app.run_test(size=size) as pilot:
        robot.change()
        app.draw()
        await pilot.pause()
        app._display = write  # type: ignore[method-assign, assignment]
        for _ in range(count):
            robot.change()
            app.draw()
            await pilot.pause()
    return written / count


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('--robots', type=int, default=50)
    parser.add_argument('--rate', type=float, default=1.0, help='statuses of a robot a second')
    parser.add_argument('--rounds', type=int, default=10)
    parser.add_argument('--output', type=Path, default=Path('out/screen.json'))
    arguments = parser.parse_args()
    figures = {
        f'{count} robots, {columns} x {rows}': asyncio.run(
            measure(count, arguments.rate, arguments.rounds, (columns, rows))
        )
        for count in (1, arguments.robots)
        for columns, rows in ((80, 24), (200, 60))
    }
    for columns, rows in ((80, 24), (200, 60)):
        written = asyncio.run(traffic(10 * arguments.rounds, (columns, rows)))
        figures[f'drives, {columns} x {rows}'] = {'bytes a status': written}
    print(json.dumps(figures, indent=2))
    write_figures(arguments.output, figures)
    return 0


if __name__ == '__main__':
    sys.exit(main())
