# SPDX-License-Identifier: BSD-3-Clause
"""The consoles of an operator as processes, one of each kind: each is given commands, and tells what was applied."""

from __future__ import annotations

import asyncio
import contextlib
import re
import signal
import subprocess
import threading
import time
from collections.abc import Callable
from types import TracebackType
from typing import Any, Final, Self

from _terminal import Terminal
from aiohttp import ClientError, ClientSession, WSMsgType

from flexbt_testing.system.processes import executable
from flexbt_testing.waiting import DEADLINE, wait_until

OPERATOR: Final = 'ann'


class ConsoleEndedError(Exception):
    """The console has ended before it has told what became of a command."""


class Console:
    """A console process of ``console WORDS``; leaving the context kills it."""

    def __init__(self, *words: str, **streams: Any) -> None:
        self._process = subprocess.Popen([executable('console'), *words, '--operator', OPERATOR], **streams)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        self._process.kill()
        self._process.wait()

    def send_signal(self, number: signal.Signals) -> None:
        """To the process."""
        self._process.send_signal(number)

    def do(self, command: str, has_effect: Callable[[], bool]) -> None:
        """Give a command, again where its picture was too old for it; comes back when the console tells that it was
        applied, and ``has_effect``.

        Raises:
            ConsoleEndedError: the console ends before.
            AssertionError: it tells something else, or nothing for a long time.
        """
        raise NotImplementedError

    def stop(self) -> None:
        """Have the operator stop the robot, and do not wait for what is told."""
        raise NotImplementedError

    def go_on(self, seconds: float) -> None:
        """Show what comes for so long."""
        time.sleep(seconds)

    def _wait(self, done: Callable[[], object], what: str) -> None:

        def seen() -> object:
            has_ended = self._process.poll() is not None
            if found := done():
                return found
            if has_ended:
                raise ConsoleEndedError(what)
            return None

        wait_until(seen, what, DEADLINE)


class LineMode(Console):
    """A process for each command."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        super().__init__('watch', stdout=subprocess.DEVNULL)

    def send_signal(self, number: signal.Signals) -> None:
        """To the process of the latest command, or of the next one."""
        while True:
            with self._lock:
                if self._process.poll() is None:
                    super().send_signal(number)
                    return
            threading.Event().wait(0.001)

    def do(self, command: str, has_effect: Callable[[], bool]) -> None:
        """As in the base."""
        super().__exit__(None, None, None)
        with self._lock:
            super().__init__(command, '--json', '--timeout', str(DEADLINE), stdout=subprocess.PIPE, text=True)
        said, _ = self._process.communicate()
        if self._process.returncode < 0:
            raise ConsoleEndedError(command)
        assert '"result": "applied"' in said, said

    def stop(self) -> None:
        """As in the base."""
        super().__exit__(None, None, None)
        super().__init__('stop', stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)


class Screen(Console):
    """The screen in a terminal."""

    KEYS: Final = {'claim': b'c\r', 'pause': b'p\r', 'resume': b'p\r'}

    def __init__(self) -> None:
        self._terminal = Terminal()
        super().__init__('screen', **self._terminal.streams)
        self._terminal.begin()
        self._wait(lambda: b'LIVE' in self._terminal.written, 'the robot on the screen')

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        super().__exit__(kind, error, traceback)
        self._terminal.close()

    def do(self, command: str, has_effect: Callable[[], bool]) -> None:
        """As in the base."""
        answer, unsent = f'{command}: applied'.encode(), b'nothing was sent'
        while not has_effect():  # a screen that scrolls draws answers from before, too
            begin = len(self._terminal.written)

            def is_answered(begin: int = begin) -> bool:
                shown = self._terminal.written[begin:]
                return unsent in shown or (answer in shown and has_effect())

            self._terminal.type(self.KEYS[command])
            self._wait(is_answered, f'{command} on the screen')

    def stop(self) -> None:
        """As in the base: F8."""
        self._terminal.type(b'\x1b[19~')


class Page(Console):
    """The server of the page, and a page; what is signaled is the server."""

    def __init__(self) -> None:
        super().__init__('web', '--port', '0', stdout=subprocess.PIPE, text=True)
        assert self._process.stdout is not None
        told = self._process.stdout.readline()
        found = re.search(r'http://\S+/', told)
        assert found is not None, told
        self._runner = asyncio.Runner()
        self._runner.run(self._open(found[0]))

    async def _open(self, address: str) -> None:
        self._session = ClientSession()
        self._socket = await self._session.ws_connect(f'{address}link', max_msg_size=0)
        await self._socket.send_json({'hello': None})
        await self._until(lambda content: content.get('parts', {}).get('link', {}).get('state') == 'live')

    async def _until(self, done: Callable[[dict[str, Any]], object]) -> dict[str, Any]:
        async with asyncio.timeout(DEADLINE):
            while True:
                message = await self._socket.receive()
                if message.type not in (WSMsgType.TEXT, WSMsgType.BINARY):
                    raise ConsoleEndedError(str(message.type))
                if message.type is WSMsgType.TEXT and done(content := message.json()):
                    return dict(content)

    async def _do(self, command: str) -> None:
        answer, unsent = f'{command}: applied', 'nothing was sent'  # as after a stop, whose picture is old
        told = unsent
        while unsent in told:
            await self._socket.send_json({'do': command, 'decision': None})
            content = await self._until(lambda content: self._words(content, answer, unsent))
            told = content['told']['text']

    async def _read(self) -> None:
        while True:
            await self._socket.receive()

    def stop(self) -> None:
        """As in the base."""
        self._runner.run(self._socket.send_json({'do': 'stop', 'decision': None}))

    def go_on(self, seconds: float) -> None:
        """As in the base."""

        async def read() -> None:
            with contextlib.suppress(TimeoutError):
                await asyncio.wait_for(self._read(), seconds)

        self._runner.run(read())

    @staticmethod
    def _words(content: dict[str, Any], *words: str) -> set[str]:
        text = content.get('told', {}).get('text', '')
        return {word for word in words if word in text}

    def do(self, command: str, has_effect: Callable[[], bool]) -> None:
        """As in the base."""
        try:
            self._runner.run(self._do(command))
        except (ClientError, ConnectionError) as error:
            raise ConsoleEndedError(command) from error

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        super().__exit__(kind, error, traceback)
        self._runner.run(self._session.close())
        self._runner.close()


CONSOLES: Final[dict[str, type[Console]]] = {
    'console (line mode)': LineMode,
    'console (screen)': Screen,
    'console (page)': Page,
}
