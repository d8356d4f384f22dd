# SPDX-License-Identifier: BSD-3-Clause
"""How soon a STOP leaves a console while others forge what that listens to, and how much memory the console takes.

An executive is scripted. For each attack and each console (screen, page, page with five browsers, prompt, line mode)
the table has the seconds from the operator's key, message or command until the STOP is at the robot's topic, of several
in a row, and the resident memory of the console at the end of it. The line mode is a process that begins with the
command: its time includes the start of Python and ROS, which the row without an attack shows.

Usage: python3 benchmarks attacks_console [--attacks NAME ...] [--consoles NAME ...] [--seconds S] [--output FILE.json]
"""

from __future__ import annotations

import argparse
import asyncio
import contextlib
import os
import re
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from types import TracebackType
from typing import Any, Final, Self

from _figures import write_figures
from _terminal import Terminal
from aiohttp import ClientSession, ClientWebSocketResponse, WSMsgType
from domain_coordinator import domain_id

from flexbt_common import names
from flexbt_common.runtime.node_runtime import NodeRuntime
from flexbt_msgs.msg import ExecutiveCommand
from flexbt_testing.nodes.scripted_executive import ScriptedExecutive
from flexbt_testing.system.processes import executable
from flexbt_testing.waiting import wait_until

ATTACKS: Final[dict[str, tuple[str, ...]]] = {
    'none': (),
    'robots': ('robots', '1000', '1'),
    'names': ('names', '200', '10'),
    'trees': ('trees', '8', '60000'),
}
"""What :mod:`_forge` is told to forge."""

STOPS: Final = 4
BEGIN_SECONDS: Final = 120.0
STOP_SECONDS: Final = 30.0
"""For so long a STOP is waited for; one that has not come is as long."""

REST: Final = 3.0
"""Seconds from one STOP to the next."""


class Target:
    """A robot that notes when STOPs come."""

    def __init__(self, runtime: NodeRuntime) -> None:
        self.executive = ScriptedExecutive(runtime, heartbeat=1.0)
        self.stops: dict[str, float] = {}
        self._runtime = runtime
        runtime.call(self._join, BEGIN_SECONDS)

    def _join(self) -> None:
        node = self._runtime.node
        node.create_subscription(ExecutiveCommand, names.EXECUTIVE_STOP, self._note, names.stop_qos())

    def _note(self, command: Any) -> None:
        self.stops.setdefault(command.id, time.monotonic())

    def wait(self, count: int) -> float | None:
        """Return when one more STOP than so many has come; None when it does not come in time."""
        with contextlib.suppress(AssertionError):
            wait_until(lambda: len(self.stops) > count, 'the STOP', STOP_SECONDS)
        return next(iter(list(self.stops.values())[count:]), None)

    def run(self) -> None:
        """Publish that a behavior runs."""

        def begin() -> None:
            self.executive.status.state = 3
            self.executive.status.run_id = 'r'
            self.executive.status.behavior = 'Drive'
            self.executive.enter('Driving')
            self.executive.publish()

        self._runtime.call(begin, BEGIN_SECONDS)


class Console:
    """A console process; leaving the context kills it."""

    def __init__(self, *words: str, **streams: Any) -> None:
        self.process = subprocess.Popen([executable('console'), *words, '--operator', 'ann'], **streams)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        self.process.kill()
        self.process.wait()

    def stop(self) -> None:
        """Press or send it."""

    def megabytes(self) -> int:
        """Resident memory."""
        pages = int(Path(f'/proc/{self.process.pid}/statm').read_text().split()[1])
        return pages * os.sysconf('SC_PAGE_SIZE') // 10**6


class InTerminal(Console):
    """The screen, and the prompt."""

    def __init__(self, mode: str, keys: bytes) -> None:
        self._keys = keys
        self._terminal = Terminal()
        super().__init__(mode, **self._terminal.streams)
        self._terminal.begin(keeps=True)
        wait_until(lambda: 'Drive' in self._terminal.text, lambda: self._terminal.text[-3000:], BEGIN_SECONDS)
        self._terminal.forget()

    def stop(self) -> None:
        """As in the base."""
        self._terminal.type(self._keys)

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        super().__exit__(kind, error, traceback)
        self._terminal.close()


class Page(Console):
    """The server of the page, and so many pages, of which one sends the STOP and all read what comes."""

    def __init__(self, pages: int) -> None:
        super().__init__('web', '--port', '0', stdout=subprocess.PIPE, text=True)
        assert self.process.stdout is not None
        found = re.search(r'http://\S+/', self.process.stdout.readline())
        assert found is not None
        self._readers: list[subprocess.Popen[str]] = []
        for number in range(pages):
            words = [sys.executable, str(Path(__file__).parents[1]), 'attacks_console', '--page', found[0]]
            self._readers.append(subprocess.Popen(words, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True))
            assert self._readers[number].stdout is not None
        for reader in self._readers:
            assert reader.stdout is not None and reader.stdout.readline()

    def stop(self) -> None:
        """As in the base."""
        stdin = self._readers[0].stdin
        assert stdin is not None
        stdin.write('stop\n')
        stdin.flush()

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        for reader in self._readers:
            reader.kill()
            reader.wait()
        super().__exit__(kind, error, traceback)


class Line(Console):
    """A process for each STOP."""

    def __init__(self) -> None:
        super().__init__('--help', stdout=subprocess.DEVNULL)

    def stop(self) -> None:
        """As in the base."""
        self.process.kill()
        self.process.wait()
        super().__init__('stop', stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)

    def megabytes(self) -> int:
        """Return 0: it has ended."""
        return 0


CONSOLES: Final[dict[str, Any]] = {
    'screen': lambda: InTerminal('screen', b'\x1b[19~'),
    'screen !': lambda: InTerminal('screen', b'!'),
    'prompt': lambda: InTerminal('prompt', b'stop\r'),
    'page': lambda: Page(1),
    'page x 5': lambda: Page(5),
    'line': Line,
}


async def page(address: str) -> None:
    """Act as a browser for the server: read all that comes, and send what the parent says."""
    async with ClientSession() as session, session.ws_connect(f'{address}link', max_msg_size=0) as socket:
        await socket.send_json({'hello': None})
        reader = asyncio.StreamReader()
        await asyncio.get_running_loop().connect_read_pipe(lambda: asyncio.StreamReaderProtocol(reader), sys.stdin)
        sends = asyncio.create_task(_send(socket, reader))
        told = False
        async for message in socket:
            if message.type is WSMsgType.TEXT and not told:
                told = True
                print('open', flush=True)
        sends.cancel()


async def _send(socket: ClientWebSocketResponse, reader: asyncio.StreamReader) -> None:
    while line := await reader.readline():
        await socket.send_json({'do': line.decode().strip(), 'decision': None})


@contextlib.contextmanager
def forging(*words: str) -> Iterator[None]:
    """Run :mod:`_forge` with these words meanwhile; nothing without words."""
    if not words:
        yield
        return
    script = str(Path(__file__).with_name('_forge.py'))
    with subprocess.Popen([sys.executable, script, *words, str(os.getpid())], stdout=subprocess.PIPE) as forger:
        try:
            assert forger.stdout is not None and forger.stdout.readline()
            yield
        finally:
            forger.kill()


def measure(target: Target, attack: str, name: str, seconds: float) -> dict[str, Any]:
    """One console under one attack."""
    took = []
    target.run()
    with CONSOLES[name]() as console, forging(*ATTACKS[attack]):
        time.sleep(seconds)
        for _ in range(STOPS):
            target.run()
            known, began = len(target.stops), time.monotonic()
            console.stop()
            came = target.wait(known)
            took.append(STOP_SECONDS if came is None else round(came - began, 2))
            time.sleep(REST)
        memory = console.megabytes()
    return {'attack': attack, 'console': name, 'seconds': took, 'megabytes': memory}


def main() -> int:
    """Measure, and print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('--attacks', nargs='+', default=list(ATTACKS), choices=ATTACKS)
    parser.add_argument('--consoles', nargs='+', default=list(CONSOLES), choices=CONSOLES)
    parser.add_argument('--seconds', type=float, default=30.0, help='of the attack before the first STOP')
    parser.add_argument('--output', type=Path)
    parser.add_argument('--page', help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.page:
        asyncio.run(page(options.page))
        return 0
    rows = []
    with domain_id() as domain:
        os.environ['ROS_DOMAIN_ID'] = str(domain)
        with NodeRuntime.open('onboard_executive') as runtime:
            target = Target(runtime)
            for attack in options.attacks:
                for name in options.consoles:
                    rows.append(measure(target, attack, name, options.seconds))
                    row = rows[-1]
                    print(f'{attack:8} {name:10} {row["megabytes"]:5} MB  {row["seconds"]} s', flush=True)
    if options.output is not None:
        write_figures(options.output, {'attacks_console': rows})
    return 0 if all(max(row['seconds']) < 1.0 for row in rows if row['console'] != 'line') else 1


if __name__ == '__main__':
    sys.exit(main())
