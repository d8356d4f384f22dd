# SPDX-License-Identifier: BSD-3-Clause
"""The server of the page: who may use it, what it takes, what it tells, and that no answer reaches another decision."""

from __future__ import annotations

import asyncio
import contextlib
import dataclasses
import functools
import gc
import json
import threading
from collections.abc import AsyncIterator, Awaitable, Callable
from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path
from typing import Any

import pytest
from aiohttp import (
    ClientSession,
    ClientWebSocketResponse,
    TCPConnector,
    WSCloseCode,
    WSMessage,
    WSMsgType,
    WSServerHandshakeError,
)
from hypothesis import given
from hypothesis import strategies as st
from web_support import NASTY, OTHER, PLAN, STRUCTURE, WHERE, WebRobot, WebRobots, served

from flexbt_common.files import ALERTS, home_path
from flexbt_console.alerts.escalation import Thing
from flexbt_console.alerts.store import Store
from flexbt_console.commands import command_builder
from flexbt_console.commands.spec import Role
from flexbt_console.errors import NoAnswerError, RefusedError, UsageError
from flexbt_console.mirror.fleet import Fleet
from flexbt_console.mirror.mirror import Mirror
from flexbt_console.mirror.records import (
    CommandKind,
    ExecutiveState,
    FramedPose,
    GridMap,
    LogLine,
    LogSeverity,
    StateKind,
    StateStructure,
    Structure,
    Synthesis,
    SynthesisRequest,
)
from flexbt_console.mirror.trees import MirroredNode, MirroredStatus, TreeNodes, TreeReport
from flexbt_console.ui import answers
from flexbt_console.ui.station import Session
from flexbt_console.ui.web import drawings, picture, requests
from flexbt_console.ui.web import server as web_run
from flexbt_console.ui.web.access import ANYBODY, GUESS_SECONDS, GUESSES, Access, WrongTokens, source_of
from flexbt_console.ui.web.drawings import Drawings, machine_drawing
from flexbt_console.ui.web.greetings import GREETING_OF_SOURCE, MOST_GREETING
from flexbt_console.ui.web.page_link import MOST_AT_ONCE, PageLink
from flexbt_console.ui.web.picture import MOST_CELLS, Pictures, map_part
from flexbt_console.ui.web.requests import (
    BURST,
    MESSAGE_BYTES,
    MOST_FOLDED,
    NAME_CHARACTERS,
    RATE,
    operator_name,
)
from flexbt_console.ui.web.server import MOST_CONNECTIONS, MOST_OPERATORS, MOST_PAGES
from flexbt_core.clock.rates import SenderRates
from flexbt_testing.waiting import DEADLINE


class Page:
    """A page without a browser."""

    def __init__(self, socket: ClientWebSocketResponse) -> None:
        self.socket = socket
        self.parts: dict[str, Any] = {}
        self.told: list[str] = []
        self.maps: list[bytes] = []
        self.messages: list[dict[str, Any]] = []

    async def until(self, done: Callable[[], object]) -> None:
        """Take messages until that is so."""
        async with asyncio.timeout(DEADLINE):
            while not done():
                message = await self.socket.receive()
                if message.type is WSMsgType.BINARY:
                    self.maps.append(message.data)
                    continue
                assert message.type is WSMsgType.TEXT, (message, self.told)
                content = json.loads(message.data)
                self.messages.append(content)
                self.parts.update(content.get('parts', {}))
                self.told += [content['told']['text']] if 'told' in content else []

    async def ask(self, **message: Any) -> str:
        """Send that, and give what is told next."""
        before = len(self.told)
        await self.socket.send_json(message)
        await self.until(lambda: len(self.told) > before)
        return self.told[-1]

    async def closed(self) -> int | None:
        """Return the code with which the server closes the connection."""
        async with asyncio.timeout(DEADLINE):
            while (await self.socket.receive()).type not in (WSMsgType.CLOSE, WSMsgType.CLOSED, WSMsgType.CLOSING):
                pass
        return self.socket.close_code


@contextlib.asynccontextmanager
async def page(
    port: int, hello: object = None, robot: str = '', operator: object = None, **options: Any
) -> AsyncIterator[Page]:
    async with (
        ClientSession() as session,
        session.ws_connect(f'http://127.0.0.1:{port}/link?robot={robot}', max_msg_size=0, **options) as socket,
    ):
        await socket.send_json({'hello': hello, 'operator': operator})
        yield Page(socket)


def with_page(robot: WebRobot, steps: Callable[[Page], Awaitable[None]]) -> None:
    async def run(port: int) -> None:
        async with page(port) as opened:
            await opened.until(lambda: 'link' in opened.parts)
            await steps(opened)

    with served({'robot': robot.station()}) as port:
        asyncio.run(run(port))


def test_a_stop_waits_for_no_encoding_and_pages_share_what_is_encoded(monkeypatch: pytest.MonkeyPatch) -> None:
    robot, pages = WebRobot(), 5
    begun, free, made = threading.Semaphore(0), threading.Event(), picture.parts_of

    def slow(*arguments: Any) -> Any:
        begun.release()
        assert free.wait(DEADLINE)
        return made(*arguments)

    async def run(port: int) -> None:
        async with contextlib.AsyncExitStack() as stack:
            opened = [await stack.enter_async_context(page(port)) for _ in range(pages)]
            try:
                assert await asyncio.to_thread(begun.acquire, timeout=DEADLINE)
                await opened[0].socket.send_json({'do': 'stop', 'decision': None})
                await asyncio.to_thread(robot.wait_sent, 1)
                assert robot.kinds == [CommandKind.STOP]
            finally:
                free.set()
            for one in opened:
                await one.until(lambda one=one: 'link' in one.parts)  # type: ignore[misc]
            others = 0
            while begun.acquire(blocking=False):
                others += 1
            assert others < pages

    monkeypatch.setattr(picture, 'parts_of', slow)
    with served({'robot': robot.station()}) as port:
        asyncio.run(run(port))


def test_of_what_is_too_large_a_part_is_shown_and_what_is_left_out_is_told() -> None:
    robot = WebRobot()
    nodes = [MirroredNode(uid, uid // 2, f'{uid} {"x" * 900}', 'Sequence') for uid in range(1, 2_001)]
    robot.mirror.receive_tree_structure(TreeNodes('t', 'Large', nodes, 1.0, 1, 58_000))
    report = TreeReport('t', 1, [MirroredStatus.RUNNING] * 2_000, [], 5.0, finished=False, paused=False)
    robot.mirror.receive_tree_status(report)
    robot.mirror.receive_log(LogLine('e', 2, LogSeverity.INFO, 'y' * 100_000, '/Drive', 'r1', 4.0))

    async def look(opened: Page) -> None:
        await opened.until(lambda: 'trees' in opened.parts)
        (tree,), state = opened.parts['trees'], opened.parts['tree_states']['t']
        assert len(tree['nodes']) == len(state['statuses']) == picture.MOST_LISTED
        told = f'{60_000 - picture.MOST_LISTED} of 60000 nodes of tree Large not shown'
        assert opened.parts['left_out'] == [told]
        assert max(len(json.dumps(one)) for one in opened.messages) < 200_000

    with_page(robot, look)


def test_everything_of_now_is_told() -> None:
    robot = WebRobot(is_drawn=True)
    robot.show(PLAN)

    async def look(opened: Page) -> None:
        await opened.until(lambda: opened.maps and any('drawing' in one for one in opened.messages))
        parts = opened.parts
        assert parts['link']['state'] == 'live' and parts['status']['runs'] == 'RUNNING  Patrol'
        (decision,) = parts['decisions']
        assert [choice['leads'] for choice in decision['choices']] == ['/Ask', '=finished']
        assert decision['reasons'] == [f'because WARN: {NASTY}'] and NASTY in decision['line']
        assert PLAN.id not in decision['line'] and decision['id'] == PLAN.id
        state = parts['tree_states']['t']
        assert state['statuses'] == ['running', 'success', 'running', 'idle']
        assert state['leaves'] == ['Wait'] and parts['actions']['lock']['lines'] == ['lock /Drive']
        assert (len(parts['plan']), parts['pose']['x'], list(parts['places'])) == (2, 2.0, ['kitchen'])
        head = json.loads(opened.maps[0][4 : 4 + int.from_bytes(opened.maps[0][:4])])
        assert (head['width'], head['height']) == (80, 60)
        pictures = {one['drawing']['key']: one['drawing']['svg'] for one in opened.messages if 'drawing' in one}
        assert 'id="s1o0"' in pictures[parts['machine']['drawing']]
        assert parts['machine']['behavior'] == 'Patrol' and parts['machine']['containers'] == [0]
        nodes = parts['trees'][0]['nodes']  # the page draws the tree
        assert nodes[1] == {'lines': [NASTY, '(FollowPath)'], 'kind': 'Unknown', 'parent': 0}
        assert (nodes[3]['kind'], nodes[3]['parent'], nodes[0]['parent']) == ('Condition', 0, None)
        robot.show(PLAN)  # a heartbeat
        before = len(opened.messages)
        await opened.until(lambda: len(opened.messages) > before + 1)
        for message in opened.messages[before:]:
            assert message['parts'].keys() == {'times'}  # what has not changed is not sent again

    with_page(robot, look)


def test_an_answer_is_a_value_for_a_page_that_wants_it() -> None:
    async def look(opened: Page) -> None:
        for more in ({}, {'data': 1}, {'data': True}):
            await opened.socket.send_json({'do': 'structure', **more})
        await opened.until(lambda: len([one for one in opened.messages if 'read' in one]) == 3)
        read = [one['read'] for one in opened.messages if 'read' in one]
        assert [sorted(one) for one in read] == [['text', 'title'], ['text', 'title'], ['data', 'text', 'title']]
        drive = read[2]['data']['states'][1]
        assert (drive['path'], drive['kind'], drive['transitions'][0]['target']) == ('/Drive', 'state', '/Ask')

    with_page(WebRobot(is_drawn=True), look)


def test_an_answer_tells_why_the_decision_has_waited() -> None:
    robot = WebRobot()
    robot.show(PLAN, OTHER)

    async def steps(opened: Page) -> None:
        await opened.until(lambda: 'decisions' in opened.parts)
        for decision, seconds in ((OTHER.id, 3.0), (PLAN.id, 2.0)):
            await opened.socket.send_json({'touched': True, 'decision': decision})
            await opened.ask(do='nonsense')  # so that it was heard
            robot.clock.advance(seconds)
        robot.show(PLAN, OTHER)
        assert 'applied' in await opened.ask(answer='done', decision=PLAN.id)
        assert (robot.sent[0].wait_queue, robot.sent[0].wait_interaction) == (3.0, 2.0)

    with_page(robot, steps)


def test_a_stop_waits_for_no_value_that_is_read_and_that_is_not_sent_after_it(monkeypatch: pytest.MonkeyPatch) -> None:
    robot, read, begun, go_on = WebRobot(), answers.choose, threading.Event(), threading.Event()

    def slow(*arguments: Any, **options: Any) -> Any:
        begun.set()
        assert go_on.wait(DEADLINE)
        return read(*arguments, **options)

    async def steps(opened: Page) -> None:
        await opened.socket.send_json({'answer': 'done', 'decision': 'd1'})
        await opened.socket.send_json({'do': 'autonomy high', 'decision': None})
        assert await asyncio.to_thread(begun.wait, DEADLINE)
        try:
            await opened.socket.send_json({'do': 'Stop', 'decision': None})
            await asyncio.to_thread(robot.wait_sent, 1)
        finally:
            go_on.set()
        for label in ('confirm done', 'autonomy high'):
            await opened.until(lambda label=label: f'{label}: refused: a STOP was given while' in str(opened.told))  # type: ignore[misc]

    monkeypatch.setattr(requests, 'choose', slow)
    robot.show(PLAN)
    with_page(robot, steps)
    assert robot.kinds == [CommandKind.STOP]


def test_no_value_is_read_for_a_user_who_may_not_send_it(monkeypatch: pytest.MonkeyPatch) -> None:
    def read(*_: Any) -> Any:
        raise AssertionError('the value was read')

    monkeypatch.setattr(command_builder, 'answer', read)
    robot = WebRobot()
    robot.show(WHERE)
    session = Session(dataclasses.replace(robot.station(), role=Role.OBSERVER), robot.clock)
    for message in ({'answer': '[1]', 'decision': 'd4'}, {'do': 'input [1]'}, {'do': '[1]', 'decision': 'd4'}):
        with pytest.raises(RefusedError, match='role operator'):
            requests.understood(message, session, Future(), 0)


def test_a_stop_that_comes_with_the_end_of_the_page_is_sent() -> None:
    robot = WebRobot()

    class Socket:
        """It has a stop and the end at the same time."""

        async def __aiter__(self) -> AsyncIterator[WSMessage]:
            yield WSMessage(WSMsgType.TEXT, json.dumps({'do': 'stop'}), None)

        async def send_str(self, text: str) -> None:
            """Take it."""

        send_bytes = close = send_str

    async def serve() -> None:
        socket: Any = Socket()
        one = PageLink(socket, Drawings(), Access(), {'hello': None, 'user': ANYBODY})
        pictures = Pictures(Fleet(), 'robot', robot.station(), ThreadPoolExecutor(1))
        past: Any = None
        await one.serve('robot', robot.station(), pictures, past)

    asyncio.run(asyncio.wait_for(serve(), DEADLINE))
    assert robot.kinds == [CommandKind.STOP]


def test_a_stop_waits_for_no_request_that_waits() -> None:
    robot, go_on = WebRobot(), threading.Event()

    class World:
        dropped = ()

        def is_possible(self) -> bool:
            return True

        def drop(self, x: float, y: float, timeout: float) -> str:
            assert go_on.wait(DEADLINE)
            return 'dropped'

    async def run(port: int) -> None:
        async with contextlib.AsyncExitStack() as stack:
            pages = [await stack.enter_async_context(page(port)) for _ in range(4)]
            for opened in pages:  # as many as there are threads for them, and more
                for _ in range(MOST_AT_ONCE):
                    await opened.socket.send_json({'obstacle': [1, 1]})
            for opened in pages:
                assert 'wait for their answers' in await opened.ask(obstacle=[2, 2])
                assert 'applied' in await opened.ask(do='stop', decision=None)
            assert not go_on.is_set()
            go_on.set()
            await pages[0].until(lambda: sum('dropped at' in told for told in pages[0].told) == MOST_AT_ONCE)

    with served({'robot': robot.station(World())}) as port:
        try:
            asyncio.run(run(port))
        finally:
            go_on.set()
    assert robot.kinds == [CommandKind.STOP] * 4


def test_a_search_ends_with_the_page_that_asked_for_it() -> None:
    asked, ended = threading.Event(), threading.Event()

    class Searching(WebRobot):
        def synthesis(
            self,
            request: SynthesisRequest,
            timeout: float,
            tell: Callable[[str], None],
            left: Future[None] | None = None,
        ) -> Synthesis:
            asked.set()
            assert left is not None
            left.result(DEADLINE)
            ended.set()
            raise NoAnswerError('gone')

    async def run(port: int) -> None:
        async with page(port) as other:
            async with page(port) as opened:
                await opened.socket.send_json({'do': 'synthesize X --goal g --time-limit 3600', 'decision': None})
                assert await asyncio.to_thread(asked.wait, DEADLINE)
                assert 'applied' in await other.ask(do='stop', decision=None)
            assert await asyncio.to_thread(ended.wait, DEADLINE)

    with served({'robot': Searching().station()}) as port:
        asyncio.run(run(port))


def test_a_call_is_acknowledged_at_the_prompt_of_the_page_by_its_operator(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv('HOME', str(tmp_path))
    store = Store(home_path(ALERTS))
    for number in (3, 4):
        store.memory.things[number] = Thing(number, '/arm', 'decision', '', 0.0, f'asks {number}', '', '')
    assert store.save() == ''

    async def acknowledge(opened: Page) -> None:
        listed = await opened.ask(do='alerts acknowledge', decision=None)
        assert 'name one of these:' in listed and '3  /arm: asks 3' in listed
        assert store.read('acknowledgment') == {}
        await opened.socket.send_json({'do': 'alerts acknowledge 4', 'decision': None})
        await opened.until(lambda: 'read' in opened.messages[-1])
        assert opened.messages[-1]['read']['text'] == 'acknowledged 4  /arm: asks 4'
        assert store.read('acknowledgment') == {4: 'ann'}

    with_page(WebRobot(), acknowledge)
    store.close()


def test_pages_that_wait_for_the_node_keep_no_other_one_waiting() -> None:
    robot, go_on, waiting = WebRobot(), threading.Event(), threading.Semaphore(0)

    class Busy(WebRobots):
        """A node that is busy."""

        def robot(self, name: str) -> tuple[Mirror, Any]:
            waiting.release()
            return super().robot(name)

        def open(self, name: str, operator: str = '') -> None:
            assert name == '/robot' or go_on.wait(DEADLINE)
            super().open(name, operator)

    async def run(port: int) -> None:
        async with contextlib.AsyncExitStack() as stack:
            opened = await stack.enter_async_context(page(port, robot='robot', compress=15))
            await opened.until(lambda: 'link' in opened.parts)
            try:
                for _ in range(MOST_PAGES - 1):
                    await stack.enter_async_context(page(port, robot='busy'))
                for _ in range(MOST_PAGES):
                    assert await asyncio.to_thread(waiting.acquire, timeout=DEADLINE)
                robot.mirror.receive_plan(tuple((float(x), 0.0) for x in range(5000)))  # a thread compresses it
                await opened.until(lambda: len(opened.parts['plan']) == 5000)
            finally:
                go_on.set()

    with served(Busy({'/robot': robot.station(), '/busy': WebRobot().station()})) as port:
        asyncio.run(run(port))


def test_each_page_is_an_operator_of_its_own_and_present_while_it_is_open() -> None:
    robots = WebRobots({'robot': (robot := WebRobot()).station()})

    async def run(port: int) -> None:
        async with contextlib.AsyncExitStack() as stack:
            for number, name in enumerate(('ann', 'bob', 'ann')):
                opened = await stack.enter_async_context(page(port, operator=name))
                await opened.until(lambda: 'link' in opened.parts)  # noqa: B023 - called here
                hello = opened.messages[0]['hello']
                assert (hello['operator'], hello['asks_name']) == (f'{name}@desk/page', True)
                await opened.socket.send_json({'do': 'pause', 'decision': None})
                assert (await asyncio.to_thread(robot.wait_sent, number + 1))[-1].operator == f'{name}@desk/page'
            here = sorted(operator for _, operator in robots.present)
            assert here == ['ann@desk/page', 'ann@desk/page', 'bob@desk/page']
            for number in range(MOST_OPERATORS - 2):
                opened = await stack.enter_async_context(page(port, operator=f'n{number}'))
                await opened.until(lambda: 'link' in opened.parts)  # noqa: B023 - called here
            async with page(port, operator='one too many') as refused:
                await refused.until(lambda: any('refused' in one for one in refused.messages))
                assert refused.messages[-1]['refused']['word'] == 'TOO MANY OPERATORS'
            async with page(port, operator='bob') as again:
                await again.until(lambda: 'link' in again.parts)
        async with asyncio.timeout(DEADLINE):
            while robots.present:
                await asyncio.sleep(0)

    with served(robots, operator=lambda name: f'{name}@desk/page') as port:
        asyncio.run(run(port))


@given(st.one_of(st.text(), st.text().map(lambda text: text * 50), st.none(), st.integers(), st.lists(st.text())))
def test_whatever_a_page_gives_as_a_name_is_a_short_line(given_name: object) -> None:
    name = operator_name({'hello': None, 'operator': given_name})
    assert len(name) <= NAME_CHARACTERS and (name == '' or name.isprintable())
    if isinstance(given_name, str) and given_name.isalnum() and given_name.isascii() and len(given_name) < 40:
        assert name == given_name


def test_a_container_is_folded_for_the_page_that_wants_it() -> None:
    robot = WebRobot()
    inner = StateStructure('/Watch/Look', StateKind.STATE, 'Look', (), ('done',), ('=finished',), (0,))
    watch = StateStructure('/Watch', StateKind.MACHINE, 'Watch', ('Look',), ('finished',), ('=finished',), (0,))
    top = StateStructure('/', StateKind.MACHINE, 'Patrol', ('Watch',), ('finished',))
    robot.mirror.receive_structure(Structure('r1', 'Patrol', (top, watch, inner)))

    async def look(opened: Page) -> None:
        def shown() -> str:
            key = opened.parts['folded']
            return next(
                (one['drawing']['svg'] for one in opened.messages if one.get('drawing', {}).get('key') == key), ''
            )

        await opened.until(lambda: 'id="s2"' in shown())
        assert 'id="m1in"' in shown() and opened.parts['machine']['containers'] == [0, 1]
        await opened.socket.send_json({'fold': ['/Watch', '/', '/Nowhere']})
        await opened.until(lambda: 'id="s1"' in shown())
        assert '1 state, folded' in shown() and 'id="s2"' not in shown()
        for wrong in ('/Watch', [1], ['/x'] * (MOST_FOLDED + 1)):
            assert '"fold" is a list' in await opened.ask(fold=wrong)
        await opened.socket.send_json({'fold': []})
        await opened.until(lambda: 'id="s2"' in shown())
        assert opened.parts['folded'] == opened.parts['machine']['drawing']

    with_page(robot, look)


def test_a_drawing_that_comes_back_after_many_others_is_told_again(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr('flexbt_console.ui.web.page_link.DRAWINGS_KEPT', 1)
    robot = WebRobot()

    async def look(opened: Page) -> None:
        def drawings() -> list[str]:
            return [one['drawing']['key'] for one in opened.messages if 'drawing' in one]

        for number, behavior in enumerate(('Patrol', 'Dock', 'Patrol')):
            robot.mirror.receive_structure(dataclasses.replace(STRUCTURE, behavior=behavior))
            await opened.until(lambda: len(drawings()) > number)  # noqa: B023 - called here
        assert drawings()[0] == drawings()[2] != drawings()[1]

    with_page(robot, look)


@pytest.mark.filterwarnings('error::pytest.PytestUnraisableExceptionWarning')
def test_a_server_that_ends_while_a_drawing_is_made_leaves_nothing_of_its_process(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    told = tmp_path / 'pid'
    monkeypatch.setattr(
        drawings, 'graphviz_command', lambda: ('slow', ['sh', '-c', f'echo $$ > {told}; exec sleep 60'])
    )
    robot = WebRobot()

    async def look(opened: Page) -> None:
        robot.mirror.receive_structure(STRUCTURE)
        await opened.until(lambda: told.exists() and told.read_text())

    with_page(robot, look)
    assert not Path('/proc', told.read_text().strip()).exists()
    gc.collect()  # destroys what is left


def test_a_server_that_ends_tells_its_pages() -> None:
    async def run(servers: contextlib.ExitStack, port: int) -> None:
        async with page(port) as opened:
            await opened.until(lambda: 'link' in opened.parts)
            code, _ = await asyncio.gather(opened.closed(), asyncio.to_thread(servers.close))
            assert code == WSCloseCode.GOING_AWAY

    with contextlib.ExitStack() as servers:
        asyncio.run(run(servers, servers.enter_context(served({'robot': WebRobot().station()}))))


def test_a_fault_of_the_server_is_told_and_is_in_its_log(caplog: pytest.LogCaptureFixture) -> None:
    robot = WebRobot()

    async def look(opened: Page) -> None:
        robot.show(autonomy=object())
        assert await opened.closed() == 1011

    with_page(robot, look)
    assert 'TypeError' in caplog.text


def test_a_robot_that_moves_though_it_should_stand_is_an_alarm() -> None:
    robot = WebRobot()

    async def look(opened: Page) -> None:
        for second in range(8):
            where = FramedPose(0.1 * second, 0.0)
            robot.show(state=ExecutiveState.IDLE, outcome='preempted', robot_pose=where, stamp=9.0 + second)
        await opened.until(lambda: 'THE ROBOT MOVES' in opened.parts['status']['alarm'])

    with_page(robot, look)


def test_that_the_executive_was_restarted_is_told() -> None:
    robot = WebRobot()

    async def look(opened: Page) -> None:
        robot.show(executive_id='another', state=ExecutiveState.IDLE, active_states=(), run_id='')
        await opened.until(lambda: any('the executive was restarted' in one for one in opened.told))

    with_page(robot, look)


def test_an_answer_reaches_its_own_decision_alone() -> None:
    robot = WebRobot()
    robot.show(PLAN)

    async def answer(opened: Page) -> None:
        robot.show(OTHER)  # while the page still shows the one before
        assert 'nothing was sent' in await opened.ask(answer='failed', decision='d1')
        assert 'nothing was sent' in await opened.ask(do='confirm', decision='d1')
        assert 'nothing was sent' in await opened.ask(answer='failed', decision=None)
        assert robot.sent == []
        assert 'confirm failed: applied' in await opened.ask(answer='failed', decision='d2')
        (sent,) = robot.sent
        assert (sent.kind, sent.decision_id) == (CommandKind.CONFIRM, 'd2')
        robot.show(WHERE)
        assert 'applied' in await opened.ask(answer='1.5 2 0.5', decision='d4')
        assert robot.sent[-1].kind is CommandKind.ANSWER

    with_page(robot, answer)


def test_a_picture_that_is_old_takes_a_stop_alone() -> None:
    robot = WebRobot(answers=False)
    robot.show(PLAN)

    async def blind(opened: Page) -> None:
        robot.mirror.sender_gone()
        await opened.until(lambda: opened.parts['link']['state'] == 'lost')
        for message in ({'answer': 'done'}, {'do': 'pause'}, {'do': 'confirm'}, {'do': 'start Patrol'}):
            assert 'no live link' in await opened.ask(**message, decision='d1')
        await opened.socket.send_json({'do': 'stop', 'decision': None})
        await asyncio.to_thread(robot.wait_sent, 1)
        assert robot.kinds == [CommandKind.STOP]

    with_page(robot, blind)


@pytest.mark.parametrize(
    'text',
    [
        '{',
        '[1]',
        '7',
        '"stop"',
        '{}',
        '[' * 30_000,
        '{"do": 7}',
        '{"answer": "done", "decision": 7}',
        '{"do": "force /Nowhere done", "decision": null}',
        '{"do": "sotp", "decision": null}',
        '{"do": "web", "decision": null}',
        '{"complete": ["s"]}',
        '{"obstacle": [1e999, 0]}',
        '{"obstacle": [1]}',
        '{"obstacle": [1, 2]}',
        '{"remove_obstacle": "robot"}',
        '{"do": "note \\ud800", "decision": null}',
    ],
)
def test_what_is_written_wrong_is_told_and_does_nothing(text: str) -> None:
    robot = WebRobot()

    async def wrong(opened: Page) -> None:
        await opened.socket.send_str(text)
        await opened.until(lambda: opened.told)
        assert 'fault' not in opened.told[0] and 'Traceback' not in opened.told[0]
        assert 'applied' in await opened.ask(do='pause', decision=None)  # it goes on

    with_page(robot, wrong)
    assert [kind for kind in robot.kinds if kind is not CommandKind.NOTE] == [CommandKind.PAUSE]


def test_large_messages_floods_and_bytes_end_the_connection_and_nothing_else() -> None:
    robot = WebRobot()

    async def run(port: int) -> None:
        async with page(port) as calm, page(port) as large, page(port) as flood, page(port) as binary:
            with contextlib.suppress(ConnectionError):  # it is closed before all of it has gone
                await large.socket.send_str('x' * 10_000_000)
            assert await large.closed() in (1009, 1006)
            await binary.socket.send_bytes(b'stop')
            assert await binary.closed() == 1003
            for _ in range(BURST + 50):
                await flood.socket.send_str('{"complete": "s"}')
            assert await flood.closed() == 1008
            await calm.until(lambda: 'link' in calm.parts)
            assert 'applied' in await calm.ask(do='pause', decision=None)

    with served({'robot': robot.station()}) as port:
        asyncio.run(run(port))
    assert robot.kinds == [CommandKind.PAUSE]
    assert MESSAGE_BYTES < 10_000_000


def test_the_allowance_fills_with_time() -> None:
    now = 0.0
    allowance = SenderRates(RATE, BURST, lambda: now)
    taken = 0
    while allowance.allows(b'page'):
        taken += 1
    assert taken == BURST
    now = 1.0
    assert allowance.allows(b'page')


def test_pages_of_other_sites_and_other_names_are_refused() -> None:
    async def run(port: int) -> None:
        host = f'127.0.0.1:{port}'
        async with ClientSession() as session:
            for headers, status in (
                ({'Host': 'evil.example'}, 421),  # a name that was made to point to us
                ({'Host': f'evil.example:{port}'}, 421),
                ({'Host': '[::1', 'Origin': 'http://[::1'}, 421),
                ({'Origin': 'http://evil.example'}, 403),
                ({'Origin': 'null'}, 403),
                ({'Origin': f'http://{host}.evil.example'}, 403),
                ({'Origin': 'http://localhost:1'}, 403),
            ):
                for path in ('', 'link', 'app.js'):
                    async with session.get(f'http://{host}/{path}', headers=headers) as response:
                        assert response.status == status, (headers, path)
                with pytest.raises(WSServerHandshakeError):
                    await session.ws_connect(f'http://{host}/link', headers=headers)
            async with session.ws_connect(f'http://{host}/link', headers={'Origin': f'http://{host}'}):
                pass
            for path in ('../setup.py', '%2e%2e/server.py', 'server.py', 'page', 'link', '__init__.py', 'x' * 8000):
                async with session.get(f'http://{host}/{path}') as response:
                    assert response.status in (400, 404), path
            async with session.get(f'http://{host}/') as response:
                policy = response.headers['Content-Security-Policy']
                assert "default-src 'none'" in policy and 'unsafe' not in policy
                assert '://' not in (await response.text()).replace('http://www.w3.org', '')  # nothing from elsewhere

    with served({'robot': WebRobot().station()}) as port:
        asyncio.run(run(port))


@pytest.mark.parametrize('hello', [None, '', 'wrong', '\ud800', 7, ['s3cret'], {'token': 's3cret'}])
def test_without_the_token_nothing_is_told(hello: object) -> None:
    robot = WebRobot()

    async def run(port: int) -> None:
        async with page(port, hello) as opened:
            await opened.socket.send_json({'do': 'stop', 'decision': None})
            assert await opened.closed() == 1008
            assert opened.messages == []
        async with page(port, 's3cret') as opened:
            await opened.until(lambda: 'link' in opened.parts)

    with served({'robot': robot.station()}, Access.of('127.0.0.1', 's3cret')) as port:
        asyncio.run(run(port))
    assert robot.sent == []


def test_beyond_this_computer_there_is_a_token() -> None:
    assert Access.of('127.0.0.1').token == Access.of('::1').token == Access.of('localhost').token == ''
    first = Access.of('0.0.0.0')  # noqa: S104
    second = Access.of('192.0.2.1')
    assert len(first.token) > 20 and first.token != second.token
    assert first.user_of('') is first.user_of(None) is None and first.user_of(first.token) is ANYBODY
    assert first.page_address(80).endswith(f'#token={first.token}')
    assert second.knows_host('192.0.2.1:80') and not second.knows_host('example.com:80')
    with pytest.raises(UsageError):
        Access.of('example.com')


def test_there_are_so_many_pages_and_no_more() -> None:
    async def run(port: int) -> None:
        async with contextlib.AsyncExitStack() as stack:
            opened = [await stack.enter_async_context(page(port)) for _ in range(MOST_PAGES)]
            for one in opened:
                await one.until(lambda one=one: 'link' in one.parts)  # type: ignore[misc]
            async with page(port) as refused:
                assert await refused.closed() == 1013
            assert 'applied' in await opened[0].ask(do='pause', decision=None)

    with served({'robot': WebRobot().station()}) as port:
        asyncio.run(run(port))


@pytest.mark.parametrize('path', ['link', 'costmaps'])
def test_who_says_nothing_keeps_nobody_out(path: str) -> None:
    async def run(port: int) -> None:
        address = f'http://127.0.0.1:{port}/{path}'
        async with ClientSession(connector=TCPConnector(limit=0)) as session, page(port, 's3cret') as known:
            await known.until(lambda: 'link' in known.parts)
            silent = [await session.ws_connect(address) for _ in range(MOST_PAGES + MOST_GREETING)]
            async with page(port, 's3cret') as opened:
                await opened.until(lambda: 'link' in opened.parts)
            assert await Page(silent[0]).closed() == 1006  # the oldest have given way
            assert 'applied' in await known.ask(do='pause', decision=None)

    with served({'robot': WebRobot().station()}, Access.of('127.0.0.1', 's3cret')) as port:
        asyncio.run(run(port))


@pytest.mark.parametrize(
    ('error', 'word'),
    [(KeyError('/robot'), 'NO SUCH ROBOT'), (RuntimeError("can't start new thread"), 'TRY AGAIN')],
)
def test_a_robot_that_cannot_be_opened_is_told_to_its_page(error: Exception, word: str) -> None:
    class Unopened(WebRobots):
        """Robots that were forgotten just now, or for which no thread is left."""

        def open(self, name: str, operator: str = '') -> None:
            raise error

        def close(self, name: str, operator: str = '') -> None:
            raise AssertionError(name)

    async def run(port: int) -> None:
        async with page(port) as opened:
            await opened.until(lambda: any('refused' in one for one in opened.messages))
            assert opened.messages[-1]['refused']['word'] == word

    with served(Unopened({'/robot': WebRobot().station()})) as port:
        asyncio.run(run(port))


def test_a_robot_for_which_there_was_no_thread_is_not_opened_later(monkeypatch: pytest.MonkeyPatch) -> None:
    robots, kept = WebRobots({'/robot': WebRobot().station()}), list[Callable[[], object]]()

    async def refuse(work: Callable[..., object], *arguments: object) -> None:
        kept.append(functools.partial(work, *arguments))  # as the executors of Python do
        raise RuntimeError("can't start new thread")

    async def run(port: int) -> None:
        monkeypatch.setattr(asyncio, 'to_thread', refuse)
        async with page(port) as opened:
            await opened.until(lambda: any('refused' in one for one in opened.messages))
        for work in kept:
            work()
        assert kept and robots.opened == []

    with served(robots) as port:
        asyncio.run(run(port))


def test_who_guesses_the_token_waits_and_others_do_not() -> None:
    now = [0.0]
    wrong = WrongTokens(lambda: now[0])
    guesser, neighbour, other = (source_of(one) for one in ('2001:db8::1', '2001:db8::2', '192.0.2.7'))
    assert guesser == neighbour  # who has one of these addresses has all of them
    for _ in range(GUESSES):
        assert wrong.wait(guesser) == 0.0
        wrong.note(guesser)
    assert wrong.wait(neighbour) == GUESS_SECONDS and wrong.wait(other) == 0.0
    now[0] += GUESS_SECONDS
    assert wrong.wait(guesser) == 0.0
    now[0] += 100 * GUESS_SECONDS
    wrong.note(guesser)
    assert wrong.wait(guesser) == 0.0


def test_a_guess_is_looked_at_later_and_the_right_token_from_elsewhere_at_once() -> None:
    async def run(port: int) -> None:
        for _ in range(GUESSES):
            async with page(port, 'guess') as opened:
                assert await opened.closed() == WSCloseCode.POLICY_VIOLATION
        async with page(port, 'guess') as held:
            connector = TCPConnector(local_addr=('127.0.0.2', 0))
            async with (
                ClientSession(connector=connector) as session,
                session.ws_connect(f'http://127.0.0.1:{port}/link', max_msg_size=0) as socket,
            ):
                await socket.send_json({'hello': 's3cret'})
                known = Page(socket)
                await known.until(lambda: 'link' in known.parts)
            assert not held.socket.closed
            assert await held.closed() == WSCloseCode.POLICY_VIOLATION

    with served({'robot': WebRobot().station()}, Access.of('127.0.0.1', 's3cret')) as port:
        asyncio.run(run(port))


def test_of_silent_pages_those_of_the_source_with_the_most_give_way() -> None:
    async def run(port: int) -> None:
        address = f'http://127.0.0.1:{port}/link'
        async with contextlib.AsyncExitStack() as stack:
            here, there = [
                await stack.enter_async_context(ClientSession(connector=TCPConnector(limit=0, local_addr=(source, 0))))
                for source in ('127.0.0.1', '127.0.0.2')
            ]
            quiet = await there.ws_connect(address)  # a page whose link is slow
            silent = [await here.ws_connect(address) for _ in range(2 * MOST_GREETING)]
            for one in silent[: 2 * MOST_GREETING - GREETING_OF_SOURCE]:
                assert await Page(one).closed() == 1006
            await quiet.send_json({'hello': 's3cret'})
            known = Page(quiet)
            await known.until(lambda: 'link' in known.parts)

    with served({'robot': WebRobot().station()}, Access.of('127.0.0.1', 's3cret')) as port:
        asyncio.run(run(port))


def test_malformed_requests_are_told_in_one_line_and_silent_connections_end(
    caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(web_run, 'REQUEST_SECONDS', 0.1)

    async def run(port: int) -> None:
        for begun in (b'GET /\xff HTTP/9.9\r\n\r\n', b'GET / HTTP/1.1\r\nbad header\r\n\r\n', b'\x16\x03\x01', b'G'):
            reader, writer = await asyncio.open_connection('127.0.0.1', port)
            writer.write(begun)
            async with asyncio.timeout(DEADLINE):
                with contextlib.suppress(ConnectionError):
                    await reader.read()
            writer.close()

    with served({'robot': WebRobot().station()}) as port:
        asyncio.run(run(port))
    (told,) = caplog.records
    assert told.getMessage().startswith('a malformed request was refused: ') and told.exc_info is None


@pytest.mark.parametrize('begun', [b'', b'GET / HTTP/1.1\r\nHost: 127.0.0.1\r\nX: '])
def test_connections_that_ask_for_nothing_keep_nobody_out(begun: bytes) -> None:
    async def run(port: int) -> None:
        async with contextlib.AsyncExitStack() as stack:
            known = await stack.enter_async_context(page(port))
            await known.until(lambda: 'link' in known.parts)
            idle = [await asyncio.open_connection('127.0.0.1', port) for _ in range(MOST_CONNECTIONS + 20)]
            for _, writer in idle:
                stack.callback(writer.close)
                writer.write(begun)
            for _ in range(2):  # the second comes when all before are known to the server
                async with page(port) as opened:
                    await opened.until(lambda opened=opened: 'link' in opened.parts)  # type: ignore[misc]
            async with asyncio.timeout(DEADLINE):
                for reader, _ in idle[:20]:  # the oldest have given way
                    with contextlib.suppress(ConnectionError):
                        assert await reader.read() == b''
            assert 'applied' in await known.ask(do='pause', decision=None)

    with served({'robot': WebRobot().station()}) as port:
        asyncio.run(run(port))


def test_a_page_shows_the_robot_that_it_names_and_a_line_of_each() -> None:
    one, two, pushed = WebRobot(), WebRobot(), WebRobot()
    two.show(PLAN)
    for second in range(8):
        where = FramedPose(0.1 * second, 0.0)
        pushed.show(state=ExecutiveState.IDLE, outcome='preempted', robot_pose=where, stamp=9.0 + second)

    async def run(port: int) -> None:
        async with (
            ClientSession() as session,
            session.ws_connect(f'http://127.0.0.1:{port}/link?robot=one', max_msg_size=0) as socket,
        ):
            await socket.send_json({'hello': None})
            opened = Page(socket)
            await opened.until(lambda: 'robots' in opened.parts)
            assert opened.parts['decisions'] == []
            names = [line['name'] for line in opened.parts['robots']]
            assert names == ['pushed', 'two', 'one']  # the most urgent first
            assert 'THE ROBOT MOVES' in opened.parts['robots'][0]['text']
            assert 'applied' in await opened.ask(do='pause', decision=None)

    robots = WebRobots({'one': one.station(), 'two': two.station(), 'pushed': pushed.station()})
    with served(robots) as port:
        asyncio.run(run(port))
    assert (one.kinds, two.sent) == ([CommandKind.PAUSE], [])


def test_a_robot_that_comes_later_has_its_line_its_place_on_the_map_and_its_page() -> None:
    first, second, elsewhere = WebRobot(), WebRobot(), WebRobot()
    second.show(robot_pose=FramedPose(1.0, 0.5, 0.25))
    elsewhere.mirror.receive_map(GridMap(2, 2, 0.05, 0.0, 0.0, bytes(4)))
    robots = WebRobots({'/first': first.station()})

    async def run(port: int) -> None:
        async with page(port, robot='frist') as early:
            await early.until(lambda: early.messages)
            (refused,) = (one['refused'] for one in early.messages)
            assert refused['word'] == 'NO SUCH ROBOT' and "did you mean '/first'?" in refused['text']
            assert [one['name'] for one in refused['robots']] == ['/first']
            assert await early.closed() == WSCloseCode.TRY_AGAIN_LATER
        async with page(port) as opened:
            await opened.until(lambda: 'others' in opened.parts)
            assert (opened.parts['others'], robots.opened) == ([], ['/first'])
            robots.come('/second', second.station())
            robots.come('/elsewhere', elsewhere.station())
            await opened.until(lambda: len(opened.parts['robots']) == 3 and opened.parts['others'])
            (other,) = opened.parts['others']  # the map of the third is another one
            assert (other['name'], other['x'], other['live']) == ('/second', 1.0, True)
            async with page(port, robot='second') as late:
                await late.until(lambda: late.parts.get('pose', {}).get('x') == 1.0)
                assert robots.opened == ['/first', '/second']
                assert 'applied' in await late.ask(do='pause', decision=None)
            second.clock.advance(60.0)
            second.mirror.sender_gone()  # nobody knows where it is now
            await opened.until(lambda: opened.parts['others'] == [])

    with served(robots) as port:
        asyncio.run(run(port))
    assert (robots.opened, first.sent, second.kinds) == ([], [], [CommandKind.PAUSE])


@pytest.mark.parametrize(('width', 'height'), [(3001, 1999), (1, 16_000_000), (10, 10)])
def test_a_large_map_becomes_smaller_and_no_wall_gets_lost(width: int, height: int) -> None:
    cells = bytearray(width * height)
    cells[-1] = 100
    cells[0] = 255
    head, sent = map_part(GridMap(width, height, 0.05, -1.0, -2.0, bytes(cells)))
    assert len(sent) == head['width'] * head['height'] <= MOST_CELLS
    assert (sent[0], sent[-1]) == (2, 1) and sent.count(0) == len(sent) - 2
    assert head['width'] * head['resolution'] == pytest.approx(width * 0.05, abs=head['resolution'])


@pytest.mark.parametrize('children', [('',), ('A', 'A'), ('A/B', 'A')])
def test_a_machine_whose_containers_have_odd_children_is_drawn(children: tuple[str, ...]) -> None:
    """Else no page of the robot would show anything."""
    paths = {'/': children, '/A': ('B',), '/A/B': ()}
    states = [StateStructure(path, StateKind.MACHINE, children=inside) for path, inside in paths.items()]
    drawn = machine_drawing(Structure('r', 'Odd', tuple(states)))
    assert drawn.dot.count('subgraph') == (1 if children == ('',) else 3)
