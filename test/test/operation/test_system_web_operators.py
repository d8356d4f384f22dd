# SPDX-License-Identifier: BSD-3-Clause
"""Two pages of one server with a real robot: two operators, each present as long as its page is open."""

from __future__ import annotations

import asyncio
import json
import re
import signal
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager, suppress
from pathlib import Path
from typing import Any

from aiohttp import ClientSession, WSMsgType

from flexbt_testing.system.processes import Stack
from flexbt_testing.system.python_processes import start_console

DEADLINE = 120.0


class Page:
    """What a page knows, and what it sends."""

    def __init__(self, socket: Any) -> None:
        self.parts: dict[str, Any] = {}
        self.told: list[str] = []
        self._socket = socket

    async def until(self, done: Callable[[dict[str, Any]], object]) -> None:
        """Take messages until that is so."""
        async with asyncio.timeout(DEADLINE):
            while True:
                with suppress(KeyError, IndexError, TypeError):
                    if done(self.parts):
                        return
                message = await self._socket.receive()
                assert message.type in (WSMsgType.TEXT, WSMsgType.BINARY), message
                if message.type is WSMsgType.TEXT:
                    content = json.loads(message.data)
                    self.parts.update(content.get('parts', {}))
                    self.told += [content['told']['text']] if 'told' in content else []

    async def do(self, line: str, answer: str = 'applied') -> None:
        """Send a line, and wait until that is told of it."""
        before = len(self.told)
        await self._socket.send_json({'do': line, 'decision': None})
        await self.until(lambda parts: any(answer in told for told in self.told[before:]))


@asynccontextmanager
async def page_of(address: str, operator: str) -> AsyncIterator[Page]:
    async with ClientSession() as session, session.ws_connect(f'{address}link', max_msg_size=0) as socket:
        await socket.send_json({'hello': None, 'operator': operator})
        page = Page(socket)
        await page.until(lambda parts: parts['link']['state'] == 'live')
        yield page


def test_two_pages_are_two_operators_and_each_is_gone_with_its_page(tmp_path: Path) -> None:
    async def operate(address: str) -> None:
        async with page_of(address, 'bob') as bob:
            async with page_of(address, 'ann') as ann:
                await ann.do('claim')
                await bob.until(lambda parts: parts['status']['authority'].startswith('ann@'))
                await bob.do('autonomy low', 'has the authority to command')
                await bob.do('claim')
                await ann.until(lambda parts: parts['status']['asked'].startswith('bob@'))
                await bob.do('stop')  # which needs none
            await bob.until(lambda parts: parts['status']['authority'].startswith('bob@'))  # ann has gone
            await bob.do('autonomy low')

    with Stack(tmp_path) as stack:
        stack.start('onboard_executive', {'authority_timeout': '1.0', 'use_sim_time': 'false'})
        with start_console('web', '--port', '0', '--timeout', '60') as web:
            try:
                assert web.stdout is not None
                found = re.search(r'http://127\.0\.0\.1:\d+/', web.stdout.readline())
                assert found is not None
                asyncio.run(operate(found[0]))
                web.send_signal(signal.SIGINT)
                assert web.wait(DEADLINE) == 0
            finally:
                web.kill()
