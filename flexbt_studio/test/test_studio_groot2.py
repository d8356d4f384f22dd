# SPDX-License-Identifier: BSD-3-Clause
"""Programs with Groot2's port in the live view: BehaviorTree.CPP itself, this engine, and peers that do it wrong."""

from __future__ import annotations

import asyncio
import contextlib
import json
import signal
import socket
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
import zmq
from test_studio_server import Page, Refused, with_pages

from flexbt_core import ManualClock, Tree, TreeLibrary, builtin_registry, load_xml
from flexbt_server.groot2.protocol import HEADER_BYTES, RequestType, reply_header, request_header
from flexbt_server.groot2.server import Groot2Server
from flexbt_studio.server import groot2_robot
from flexbt_studio.server.groot2_robot import described, robot_name
from flexbt_testing.behavior_trees import wheel
from flexbt_testing.system.processes import free_pair
from flexbt_testing.waiting import DEADLINE

PROGRAM = Path(__file__).with_name('groot2_program.py')
TREE = """<root BTCPP_format="4" main_tree_to_execute="Main">
  <BehaviorTree ID="Main">
    <KeepRunningUntilFailure>
      <Sequence name="round">
        <Script code="laps := 3"/>
        <Sleep name="rest" msec="50"/>
        <SubTree ID="Inner" name="first" laps="{laps}"/>
        <SubTree ID="Inner" laps="{laps}"/>
        <SubTree ID="Inner" name="Inner" laps="{laps}"/>
      </Sequence>
    </KeepRunningUntilFailure>
  </BehaviorTree>
  <BehaviorTree ID="Inner">
    <ForceSuccess><Fallback><AlwaysFailure/><Sleep msec="10"/></Fallback></ForceSuccess>
  </BehaviorTree>
</root>
"""


@contextlib.contextmanager
def program(engine: str, port: int, folder: Path, tree: str) -> Iterator[subprocess.Popen[bytes]]:
    file = folder / 'program.txt'
    file.write_text(tree)
    process = subprocess.Popen([sys.executable, str(PROGRAM), engine, str(port), str(file)])
    try:
        yield process
    finally:
        process.kill()
        process.wait()


async def until(page: Page, is_so: Callable[[dict[str, Any]], Any]) -> dict[str, Any]:
    """Return the next event of what runs for which this is so."""
    while True:
        event = await page.event('live')
        if is_so(event):
            return event


def statuses(event: dict[str, Any]) -> dict[str, str]:
    return dict(event['trees'][0]['statuses']) if event['trees'] else {}


@pytest.mark.parametrize('engine', ['own', 'library'])
def test_a_program_is_watched_held_and_released_and_may_hang_and_die(engine: str, tmp_path: Path) -> None:
    if engine == 'library' and not wheel.available():
        pytest.skip('behaviortreepy is not installed')
    port, project = free_pair(), tmp_path / 'project'
    project.mkdir()

    async def story(page: Page) -> None:
        with program(engine, port, tmp_path, TREE) as process:
            robot = await page.ask('watch', robot=f'groot2 {port}')
            assert robot == robot_name(f'127.0.0.1:{port}')
            event = await until(page, lambda one: statuses(one).get('rest') == 'RUNNING')
            tree = event['trees'][0]
            places = await page.ask('run_nodes', file=tree['file'], tree=tree['tree'])
            assert len(places) == tree['nodes'] and statuses(event).keys() <= places.keys()
            model = await page.ask('open', file=tree['file'])
            assert model['text'].count('<BehaviorTree ID="Inner">') == 1 and not model['gestures']
            assert '<Sequence name="round">' in model['text'] and '_uid' not in model['text']
            with pytest.raises(Refused, match='copy the text'):
                await page.ask('edit', file=tree['file'], version=model['version'], edits=[[0, 0, ' ']])

            await page.ask('groot2', robot=robot, do='break rest --tree Main')
            event = await until(page, lambda one: one['holds'])
            assert event['holds'][0]['path'] == event['points'][0]['path'] == 'rest'
            await page.ask('groot2', robot=robot, do='tree run-to rest')  # once more around; the breakpoint stays
            await until(page, lambda one: not one['holds'])
            await until(page, lambda one: one['holds'])
            board = await page.ask('groot2', robot=robot, do='tree blackboard')
            assert {'scope': '', 'key': 'laps', 'text': '3', 'writes': []} in board['entries']
            for wrong in ('tree step', 'tree dummy rest MAYBE', 'break', "break 'rest", 'stop', ''):
                with pytest.raises(Refused, match=r'not possible|quotation'):
                    await page.ask('groot2', robot=robot, do=wrong)
            await page.ask('groot2', robot=robot, do='tree clear rest')  # by which the tree goes on

            told = asyncio.Queue[dict[str, Any]]()
            other = groot2_robot.Groot2Robot(robot, told.put_nowait, lambda file, text: asyncio.sleep(0.0))
            while not statuses(await told.get()):
                pass
            await other.command('break rest')
            await until(page, lambda one: one['holds'])
            await page.ask('groot2', robot=robot, do='tree continue')
            await other.command('tree clear')
            await until(page, lambda one: not one['holds'] and not one['points'])
            await other.close()

            await page.ask('groot2', robot=robot, do='tree run-to first/Sleep::9')
            event = await until(page, lambda one: one['holds'])
            assert event['holds'][0]['path'] == 'first/Sleep::9'
            await page.ask('groot2', robot=robot, do='tree continue')
            await until(page, lambda one: not one['holds'] and not one['points'])  # it holds once
            await page.ask('groot2', robot=robot, do='tree dummy rest FAILURE')
            await until(page, lambda one: not one['holds'] and statuses(one).get('round') == 'FAILURE')
            await page.ask('groot2', robot=robot, do='tree clear')
            event = await until(page, lambda one: not one['holds'] and statuses(one).get('round') == 'RUNNING')
            assert not event['points']
            with pytest.raises(Refused, match="did you mean 'rest'"):
                await page.ask('groot2', robot=robot, do='break rst')

            process.send_signal(signal.SIGSTOP)
            event = await until(page, lambda one: one['link'] == 'lost')
            assert 'does not answer' in event['problem'] and event['trees'], 'the last known state stays'
            process.send_signal(signal.SIGCONT)
            await until(page, lambda one: one['link'] == 'live')
            process.kill()
            await until(page, lambda one: one['link'] == 'lost')
        with program(engine, port, tmp_path, TREE.replace('rest', 'pause')):
            event = await until(page, lambda one: statuses(one).get('pause') == 'RUNNING')
            assert 'name="pause"' in (await page.ask('open', file=event['trees'][0]['file']))['text']

    with_pages(project, story)


def test_a_tree_that_is_held_before_it_was_seen_is_shown(monkeypatch: pytest.MonkeyPatch) -> None:
    """It has other nodes than the tree before it, which have been ticked, and a breakpoint of another client."""
    monkeypatch.setattr(groot2_robot, 'PERIOD', 3600.0)
    monkeypatch.setattr(groot2_robot, 'LONGEST_REST', 3600.0)

    def tree(leaves: int) -> Tree:
        text = f'<root><BehaviorTree ID="T"><Sequence>{"<AlwaysSuccess/>" * leaves}</Sequence></BehaviorTree></root>'
        return Tree(TreeLibrary([load_xml(text, 't.xml', builtin_registry())]), 'T', clock=ManualClock())

    async def story(server: Groot2Server, port: int) -> None:
        told = asyncio.Queue[dict[str, Any]]()
        robot = groot2_robot.Groot2Robot(robot_name(str(port)), told.put_nowait, lambda file, text: asyncio.sleep(0.0))
        while not (await told.get())['trees']:
            pass
        await robot.command('break AlwaysSuccess::2')
        larger = tree(5)
        with server.watch(larger):
            larger.tick_once()
            hook = {'enabled': True, 'uid': 2, 'mode': 0, 'once': False, 'desired_status': 'SKIPPED', 'position': 0}
            server.answer([request_header(RequestType.HOOK_INSERT), json.dumps(hook).encode()])
            ticking = asyncio.create_task(asyncio.to_thread(larger.tick_once))
            while not (event := await told.get())['holds']:
                pass
            assert (event['holds'][0]['path'], event['trees'][0]['nodes']) == ('AlwaysSuccess::2', 6)
            await robot.command('tree continue')
            await ticking
        await robot.close()

    port = free_pair()
    with Groot2Server(port) as server, server.watch(tree(1)):
        asyncio.run(asyncio.wait_for(story(server, port), DEADLINE))


def test_a_sub_tree_keeps_its_name_and_the_main_tree_its_blackboard() -> None:
    """One has a slash in its name, the other the ID of the main tree."""
    places = ''.join(f'<SubTree ID="In" _fullpath="{name}" _uid="{uid}"/>' for uid, name in ((2, 'a/b'), (3, 'T')))
    leaf = '<SubTree ID="Leaf" _fullpath="{0}/Leaf::{1}" _uid="{1}"/>'
    inner = f'<BehaviorTree ID="In" _fullpath="{{0}}">{leaf}</BehaviorTree>'
    trees = f'<BehaviorTree ID="T" _fullpath=""><Sequence _uid="1">{places}</Sequence></BehaviorTree>'
    _, document, nodes, boards = described('p', f'<root>{trees}{inner.format("a/b", 4)}{inner.format("T", 5)}</root>')
    assert '<SubTree name="a/b" ID="In"/>' in document and '<SubTree ID="Leaf"/>' in document
    assert nodes == {1: 'Sequence::1', 2: 'a/b', 3: 'T', 4: 'a/b/Leaf::4', 5: 'T/Leaf::5'}
    assert boards == {'T': '', 'a/b': 'a/b'}
    like = '<BehaviorTree ID="In" _fullpath="In"><SubTree ID="Leaf" _fullpath="In/l" _uid="2"/></BehaviorTree>'
    leaf = '<BehaviorTree ID="Leaf" _fullpath="In/l"><AlwaysSuccess _uid="3"/></BehaviorTree>'
    main = '<BehaviorTree ID="T" _fullpath=""><SubTree ID="In" _fullpath="In::1" _uid="1"/></BehaviorTree>'
    _, _, nodes, boards = described('p', f'<root>{main}{like}{leaf}</root>')  # as of BehaviorTree.CPP
    assert nodes == {1: 'In::1', 2: 'In::1/l', 3: 'In::1/l/AlwaysSuccess::3'}
    assert boards == {'T': '', 'In': 'In::1', 'In/l': 'In::1/l'}


class Peer:
    """A peer that answers requests for the tree and for statuses by what a test says."""

    def __init__(self, port: int, tree: bytes, status: bytes, spoil: Callable[[bytes], bytes] = bytes) -> None:
        context = zmq.Context()
        replies = context.socket(zmq.REP)
        replies.set(zmq.LINGER, 0)
        replies.bind(f'tcp://127.0.0.1:{port}')

        def serve() -> None:
            with contextlib.suppress(zmq.ContextTerminated), replies:
                while True:
                    frames = replies.recv_multipart()
                    kinds = {RequestType.FULL_TREE: tree, RequestType.STATUS: status, RequestType.HOOKS_DUMP: b'[]'}
                    header = reply_header(frames[0][:HEADER_BYTES], bytes(16))
                    replies.send_multipart([spoil(header), kinds.get(RequestType(frames[0][1]), b'')])

        self._thread = threading.Thread(target=serve)
        self._thread.start()
        self._context = context

    def close(self) -> None:
        self._context.term()
        self._thread.join()


SMALL = b'<root><BehaviorTree ID="T"><AlwaysSuccess name="x" _uid="1"/></BehaviorTree></root>'
HUGE = SMALL.replace(b'<AlwaysSuccess', b'<AlwaysSuccess key="' + b'x' * 10_000_000 + b'"')
DEEP = b'<root><BehaviorTree ID="T">' + b'<Inverter>' * 5000 + b'</Inverter>' * 5000 + b'</BehaviorTree></root>'
FAULTS: dict[str, tuple[bytes, bytes, Callable[[bytes], bytes], str]] = {
    'another version': (SMALL, b'', lambda header: b'\x01' + header[1:], 'version 1 of the protocol is not known'),
    'another protocol': (SMALL, b'', lambda header: b'hello', 'speaks another protocol than Groot2'),
    'no tree': (b'<root/>', b'', bytes, 'sends no tree'),
    'no XML': (b'\xff\x00<', b'', bytes, 'cannot be read'),
    'too large': (HUGE, b'', bytes, 'more than is shown'),
    'too deep': (DEEP, b'', bytes, 'cannot be read'),
    'half a status': (SMALL, b'\x01', bytes, 'no statuses'),
    'no status': (SMALL, b'\x01\x00\xff', bytes, 'no statuses'),
}


@pytest.mark.parametrize('fault', FAULTS)
def test_a_peer_that_does_it_wrong_is_named_and_the_studio_goes_on(fault: str, tmp_path: Path) -> None:
    tree, status, spoil, told = FAULTS[fault]
    port = free_pair()

    async def story(page: Page) -> None:
        peer = Peer(port, tree, status, spoil)
        try:
            robot = await page.ask('watch', robot=f'groot2 localhost:{port}')
            event = await until(page, lambda one: told in one['problem'])
            assert event['link'] == 'lost' and event['robot'] == robot
            assert await page.ask('files') == []
        finally:
            await asyncio.to_thread(peer.close)
        peer = Peer(port, SMALL, b'\x01\x00\x02')
        try:
            await until(page, lambda one: one['link'] == 'live' and statuses(one) == {'x': 'SUCCESS'})
        finally:
            await asyncio.to_thread(peer.close)

    with_pages(tmp_path, story)


def test_what_is_no_such_program(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(groot2_robot, 'ANSWER_SECONDS', 0.3)

    async def story(page: Page) -> None:
        for wrong in ('', ':', '99999', 'host:0', 'a b:1', 'host:1x', '65535'):
            with pytest.raises(Refused, match='write HOST:PORT'):
                await page.ask('watch', robot=f'groot2 {wrong}')

        async def is_lost(port: int) -> None:
            await page.ask('watch', robot=f'groot2 {port}')
            await until(page, lambda one: str(port) in one['robot'] and 'Groot2Publisher' in one['problem'])

        await is_lost(1)
        await is_lost(free_pair())  # nobody listens there
        with socket.create_server(('127.0.0.1', 0)) as other:  # it takes connections, and says what no peer says

            def chatter() -> None:
                with contextlib.suppress(OSError):
                    while True:
                        with contextlib.suppress(ConnectionError):
                            other.accept()[0].sendall(b'HTTP/1.1 400 Bad Request\r\n\r\n' * 1000)

            threading.Thread(target=chatter, daemon=True).start()
            await is_lost(other.getsockname()[1])
        for number in range(20000, 20005):
            await page.ask('watch', robot=f'groot2 {number}')
        with pytest.raises(Refused, match='8 programs are watched already'):
            await page.ask('watch', robot='groot2 20009')
        with pytest.raises(Refused, match='watch it first'):
            await page.ask('groot2', robot='groot2 nobody', do='break')

    with_pages(tmp_path, story)
