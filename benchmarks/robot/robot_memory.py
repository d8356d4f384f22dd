# SPDX-License-Identifier: BSD-3-Clause
"""Whether the memory of all processes of a robot and of its operators stays flat over hours: simulated ones, as fast as
possible, with all nodes and DDS.

An operator sends the robot from room to room by Navigate, a run of some goals after the other; a screen in a terminal
and a page at its server show it meanwhile. Prints the resident memory of each process (MB) after each hour: after the
second none should grow. That of the operator who commands, a console without a user interface, is `operator`.

Usage: python3 benchmarks robot_memory [--hours H] [--output FILE.json]
"""

from __future__ import annotations

import argparse
import asyncio
import contextlib
import os
import re
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator, Mapping
from itertools import cycle
from pathlib import Path
from typing import TypeVar

from _figures import write_figures
from _terminal import Terminal
from aiohttp import ClientSession
from domain_coordinator import domain_id

from flexbt_common.runtime.node_runtime import NodeRuntime
from flexbt_console.commands.command_builder import CommandBuilder
from flexbt_console.link.operator_link import ExecutiveLink
from flexbt_console.mirror.command_tracker import CommandState
from flexbt_console.mirror.mirror import Mirror
from flexbt_console.mirror.records import AutonomyLevel, OperatorCommand
from flexbt_console.mirror.view import View
from flexbt_testing.system.processes import Stack, executable

T = TypeVar('T')

ROBOT = ('simulator', 'navigation', 'bt_server', 'stop_guard', 'onboard_executive')
GOALS = ('3.8 1.2 0', '0.8 4.45 0', '9.6 6.6 0', '10.0 2.3 0')
GOALS_OF_A_RUN = 20
DEADLINE = 120.0
"""Of wall time, for whatever the operator waits for."""


class Operator:
    """Who commands."""

    def __init__(self, runtime: NodeRuntime) -> None:
        self._mirror = Mirror(runtime.steady)
        self._link = ExecutiveLink(runtime, self._mirror, 'ann')
        self._make = CommandBuilder('ann')
        self._goals = cycle(GOALS)

    def run(self) -> float:
        """Have one run made; gives the time of the robot when it has ended, s."""
        view = self._until(lambda view: view if _can_start(view) else None)
        self._give(self._make.start(view, 'Navigate', autonomy=AutonomyLevel.FULL))
        answered = ''
        for _ in range(GOALS_OF_A_RUN):
            view = self._until(lambda view, last=answered: view if _asks(view, last) else None)  # type: ignore[misc]
            assert view.decision is not None
            answered = view.decision.id
            self._give(self._make.answer(view, answered, next(self._goals)))
        view = self._until(lambda view: view if _asks(view, answered) else None)
        self._give(self._make.decline(view))
        view = self._until(lambda view: None if view.running else view)
        assert view.snapshot is not None and view.snapshot.outcome == 'finished', view.snapshot
        return view.snapshot.stamp

    def _until(self, found: Callable[[View], T | None]) -> T:
        value = self._link.wait_for(found, DEADLINE)
        if value is None:
            raise TimeoutError(f'nothing within {DEADLINE:g} s; last heard: {self._mirror.view().snapshot}')
        return value

    def _give(self, command: OperatorCommand) -> None:
        self._link.send(command, DEADLINE)
        tracked = self._link.settled(command.id, DEADLINE)
        assert tracked is not None and tracked.state is CommandState.APPLIED, tracked


def _can_start(view: View) -> bool:
    peers = view.snapshot.peers if view.snapshot is not None else ()
    return bool(view.live and view.behaviors and not view.running and peers) and all(peer.ready for peer in peers)


def _asks(view: View, last: str) -> bool:
    return view.decision is not None and view.decision.id != last


@contextlib.contextmanager
def screen() -> Iterator[int]:
    """Provide a screen in a terminal; its process."""
    terminal = Terminal()
    process = subprocess.Popen([executable('console'), '--observer'], **terminal.streams)
    terminal.begin(keeps=False)
    try:
        yield process.pid
    finally:
        process.kill()
        process.wait()
        terminal.close()


@contextlib.contextmanager
def page() -> Iterator[int]:
    """Provide the server of the page, and a page that reads its messages; yield the process of the server."""
    words = [executable('console'), 'web', '--port', '0', '--observer']
    with subprocess.Popen(words, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        told = process.stdout.readline()
        address = re.search(r'http://\S+/', told)
        assert address is not None, told

        async def read() -> None:
            async with (
                ClientSession() as session,
                session.ws_connect(f'{address[0]}link', max_msg_size=0) as socket,
            ):
                await socket.send_json({'hello': None})
                async for _ in socket:
                    pass

        reader = threading.Thread(target=lambda: asyncio.run(read()), daemon=True)
        reader.start()
        try:
            yield process.pid
        finally:
            process.kill()
            reader.join()


def resident(processes: Mapping[str, int]) -> dict[str, float]:
    """Resident memory, MB."""
    size = os.sysconf('SC_PAGE_SIZE')
    return {
        name: round(int(Path('/proc', str(process), 'statm').read_text().split()[1]) * size / 1e6, 1)
        for name, process in processes.items()
    }


def main() -> int:
    """Measure, and print a line after each hour."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('--hours', type=float, default=8.0, help='simulated')
    parser.add_argument('--every', type=float, default=3600.0, help='simulated seconds from figure to figure')
    parser.add_argument('--output', type=Path)
    options = parser.parse_args()
    figures: list[tuple[float, dict[str, float]]] = []
    with domain_id() as domain, tempfile.TemporaryDirectory() as directory:
        os.environ['ROS_DOMAIN_ID'] = str(domain)
        with Stack(Path(directory), forked=False) as stack, NodeRuntime.open('operator') as runtime:
            stack.start_all({'speed_factor': '0.0'})
            with screen() as shown, page() as served:
                processes = {name: stack.process_id(name) for name in ROBOT}
                processes |= {'screen': shown, 'page': served, 'operator': os.getpid()}
                operator, began, due = Operator(runtime), time.monotonic(), 0.0
                print(f'{"hours":>6} {"wall s":>7} {"".join(f"{name:>19}" for name in processes)}')
                while due <= options.hours * 3600.0:
                    now = operator.run()
                    if now < due:
                        continue
                    figures.append((round(now / 3600.0, 2), resident(processes)))
                    shown_figures = ''.join(f'{one:19}' for one in figures[-1][1].values())
                    print(f'{now / 3600.0:6.2f} {time.monotonic() - began:7.0f} {shown_figures}', flush=True)
                    due = (now // options.every + 1) * options.every
    if options.output is not None:
        write_figures(options.output, {'resident MB by simulated hours': figures})
    return 0


if __name__ == '__main__':
    sys.exit(main())
