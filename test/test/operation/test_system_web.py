# SPDX-License-Identifier: BSD-3-Clause
"""The operator's page with a real robot: a goal, a decision, a late answer, an obstacle, a stop; without a browser."""

from __future__ import annotations

import asyncio
import json
import re
import signal
from collections.abc import Callable, Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any

import pytest
from aiohttp import ClientSession, ClientWebSocketResponse, WSMsgType

from flexbt_testing.system.processes import Stack
from flexbt_testing.system.python_processes import start_console

DEADLINE = 120.0
BEHAVIOR = 'Navigate Split'


DEMOS = Path(__file__).parents[3] / 'flexbt_demo_behaviors' / 'flexbt_demo_behaviors'


@pytest.fixture
def address(tmp_path: Path) -> Iterator[tuple[str, str]]:
    """Yield where the page of a robot is, which also has the studio, and its token. Its behavior waits for a goal."""
    with Stack(tmp_path) as stack:
        stack.start_all({'speed_factor': '5.0'}, in_one=True)
        with start_console(*WEB) as web:
            try:
                assert web.stdout is not None
                told = web.stdout.readline()
                found = re.search(r'(http://127\.0\.0\.1:\d+/)#token=(\S+)', told)
                assert found is not None, told
                yield found[1], found[2]
                web.send_signal(signal.SIGINT)
                assert web.wait(DEADLINE) == 0
            finally:
                web.kill()


WEB = ('web', '--port', '0', '--operator', 'ann', '--timeout', '60', '--studio', str(DEMOS))


class Page:
    """What a page knows."""

    def __init__(self, socket: ClientWebSocketResponse) -> None:
        self.socket = socket
        self.parts: dict[str, Any] = {}
        self.told: list[str] = []

    async def until(self, done: Callable[[dict[str, Any]], object]) -> Any:
        try:
            async with asyncio.timeout(DEADLINE):
                return await self._until(done)
        except TimeoutError:
            known = {name: str(part)[:400] for name, part in self.parts.items()}
            raise AssertionError(f'not within {DEADLINE:g} s; told: {self.told[-3:]}; known: {known}') from None

    async def _until(self, done: Callable[[dict[str, Any]], object]) -> Any:
        while True:
            with suppress(KeyError, IndexError, TypeError):
                if found := done(self.parts):
                    return found
            message = await self.socket.receive()
            assert message.type in (WSMsgType.TEXT, WSMsgType.BINARY), message
            if message.type is WSMsgType.TEXT:
                content = json.loads(message.data)
                self.parts.update(content.get('parts', {}))
                self.told += [content['told']['text']] if 'told' in content else []

    async def do(self, line: str, **more: Any) -> None:
        before = len(self.told)
        await self.socket.send_json({'do': line, 'decision': None, **more})
        await self.until(lambda parts: any('applied' in told for told in self.told[before:]))


async def lit(studio: ClientWebSocketResponse, type: str) -> None:
    """Wait until the studio's graph of the controller's tree shows a node of this type as running."""
    file = 'navigate/controller.xml'
    for number, method in enumerate(('watch', 'open', 'run_nodes')):
        arguments = {'robot': ''} if method == 'watch' else {'file': file}
        await studio.send_json({'id': number, 'method': method, 'arguments': arguments})
    answers: dict[int, Any] = {}
    live: dict[str, Any] = {}
    async with asyncio.timeout(DEADLINE):
        while True:
            message = json.loads((await studio.receive()).data)
            if 'id' in message:
                assert 'result' in message, message
                answers[message['id']] = message['result']
            elif message['event'] == 'live':  # it may come before the answers, and is not repeated
                live = message
            if live and len(answers) == 3:
                types = {node['path']: node['type'] for node in answers[1]['view']['nodes']}
                running = [
                    types[answers[2][path][1]]
                    for tree in live['trees']
                    for path, status in tree['statuses'].items()
                    if tree['running'] and status == 'RUNNING' and path in answers[2]
                ]
                if type in running:
                    assert '/FollowPath' in live['active']
                    # By this a page knows that the robot runs the tree of the file.
                    (tree,) = [one for one in live['trees'] if one['statuses'].keys() <= answers[2].keys()]
                    assert tree['nodes'] == len(answers[2])
                    return


def test_a_robot_is_sent_off_from_the_page(address: tuple[str, str]) -> None:
    async def operate() -> None:
        url, token = address
        async with ClientSession() as session, session.ws_connect(f'{url}link', max_msg_size=0) as socket:
            await socket.send_json({'hello': token})
            page = Page(socket)
            await page.until(
                lambda parts: parts['link']['state'] == 'live' and parts['behaviors'] and parts['simulator']
            )
            await page.until(lambda parts: parts['status']['missed'] == [])
            await page.do(f"start '{BEHAVIOR}' --autonomy high")
            where = await page.until(lambda parts: parts['decisions'][0]['wants_pose'] and parts['decisions'][0])
            await page.until(lambda parts: parts['machine'])
            await socket.send_json({'answer': '10 2.3 0', 'decision': where['id']})
            judged = await page.until(lambda parts: parts['decisions'][0]['kind'] == 'choice' and parts['decisions'][0])
            await page.until(lambda parts: len(parts['plan']) > 2 and not parts['decisions'][0]['lacks'])
            leads = {choice['value']: choice['leads'] for choice in judged['choices']}
            assert leads['done'].endswith('FollowPath')
            await socket.send_json({'answer': '10 2.3 0', 'decision': where['id']})  # late: the one before
            await page.until(lambda parts: 'nothing was sent' in page.told[-1])
            assert page.parts['decisions'][0]['id'] == judged['id']
            await socket.send_json({'answer': 'done', 'decision': judged['id']})
            await page.until(lambda parts: ['FollowPath'] in [tree['leaves'] for tree in parts['tree_states'].values()])
            async with session.ws_connect(f'{url}studio/session', max_msg_size=0) as studio:
                await studio.send_json({'hello': token})
                await lit(studio, 'FollowPath')
            x, y = page.parts['pose']['x'], page.parts['pose']['y']
            await page.until(lambda parts: abs(parts['pose']['x'] - x) + abs(parts['pose']['y'] - y) > 0.5)
            await socket.send_json({'obstacle': [x, y]})  # where it has been
            (obstacle,) = await page.until(lambda parts: parts['obstacles'])
            await socket.send_json({'remove_obstacle': obstacle[0]})
            await page.until(lambda parts: parts['obstacles'] == [])
            await page.do('stop')
            await page.until(lambda parts: parts['status']['state'] == 'idle')

    asyncio.run(operate())
