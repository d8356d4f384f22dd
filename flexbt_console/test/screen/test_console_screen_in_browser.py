# SPDX-License-Identifier: BSD-3-Clause
"""The screen that textual-serve shows in a browser: a process for each tab, which ends with it and with the server."""

from __future__ import annotations

import asyncio
import re
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

pytest.importorskip('textual_serve', reason='pip install textual-serve')
from aiohttp import ClientSession, WSMsgType, WSServerHandshakeError

from flexbt_testing.waiting import DEADLINE, wait_until

COMMAND = [sys.executable, '-m', 'flexbt_console', '--observer', 'screen', '--web', '--port', '0']


@pytest.fixture
def server(capfd: pytest.CaptureFixture[str]) -> Iterator[tuple[subprocess.Popen[str], str]]:
    with subprocess.Popen(COMMAND, stdout=subprocess.PIPE, stdin=subprocess.DEVNULL, text=True) as process:
        assert process.stdout is not None
        address = re.search(r'http://(\S+)/', process.stdout.readline())
        assert address is not None
        yield process, address[1]
        process.kill()


def screens(server: int) -> list[int]:
    """The processes that a server has begun."""
    return [int(word) for word in Path(f'/proc/{server}/task/{server}/children').read_text().split()]


def test_each_tab_has_a_screen_that_ends_with_it_and_with_the_server(
    server: tuple[subprocess.Popen[str], str],
) -> None:
    process, address = server

    async def visit() -> list[int]:
        async with ClientSession() as session:
            page = await session.get(f'http://{address}/')
            assert f'ws://{address}/ws' in await page.text()
            assert "default-src 'none'" in page.headers['Content-Security-Policy']
            for headers in ({'Origin': 'http://elsewhere.example'}, {'Host': 'elsewhere.example'}):
                with pytest.raises(WSServerHandshakeError):
                    await session.ws_connect(f'http://{address}/ws', headers=headers)
            assert not screens(process.pid)
            tab = await session.ws_connect(f'http://{address}/ws?width=80&height=24')
            shown = b''
            async with asyncio.timeout(DEADLINE):
                while b'quit' not in shown:  # the last line, of the keys
                    message = await tab.receive()
                    assert message.type is WSMsgType.BINARY, message
                    shown += message.data
            other = await session.ws_connect(f'http://{address}/ws')
            await other.receive()
            both = screens(process.pid)
            assert len(both) == 2
            await tab.close()
            wait_until(lambda: len(screens(process.pid)) == 1, 'the end of the screen of the tab')
            left = screens(process.pid)
            process.kill()
            return left

    (last,) = asyncio.run(visit())
    wait_until(lambda: not Path(f'/proc/{last}').exists() or is_ended(last), 'the end of the other one')


def is_ended(process: int) -> bool:
    """Whether nobody has asked yet how it ended."""
    return Path(f'/proc/{process}/stat').read_text().rpartition(')')[2].split()[0] == 'Z'
