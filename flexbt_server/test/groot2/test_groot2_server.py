# SPDX-License-Identifier: BSD-3-Clause
"""The server of Groot2 by itself: whatever bytes it gets, several trees, several clients, and its end."""

from __future__ import annotations

import contextlib
import json
import random
import socket
import threading
from collections import deque
from collections.abc import Callable, Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import msgpack
import pytest
import zmq
from hypothesis import given
from hypothesis import strategies as st

from flexbt_core.behavior_tree.engine.leaf import ExpandingAction
from flexbt_core.behavior_tree.engine.observers import StatusLog
from flexbt_core.behavior_tree.engine.tree import Tree
from flexbt_core.behavior_tree.model.blackboard import Blackboard
from flexbt_core.behavior_tree.model.definition import TreeLibrary
from flexbt_core.behavior_tree.model.status import NodeStatus
from flexbt_core.behavior_tree.xml.reader import load_xml
from flexbt_core.clock.clock import ManualClock
from flexbt_server.groot2.log_file import LogBuffer, LogWriter, read_log
from flexbt_server.groot2.protocol import RequestType, request_header
from flexbt_server.groot2.server import Groot2Server
from flexbt_server.groot2.watched_tree import RECORDED, WatchedTree, clock
from flexbt_testing.behavior_trees.scripted_nodes import registry
from flexbt_testing.system.processes import free_pair
from flexbt_testing.waiting import DEADLINE

pytestmark = pytest.mark.dds('Groot2 talks by sockets of ZeroMQ')

DOCUMENT = """<root BTCPP_format="4"><BehaviorTree ID="One"><Sequence><Script code="x := 1"/><AlwaysSuccess/>
<SubTree ID="Two" name="two" x="{x}"/></Sequence></BehaviorTree>
<BehaviorTree ID="Two"><Sequence><Script code="y := x"/><AlwaysSuccess/></Sequence></BehaviorTree></root>"""
LIBRARY = TreeLibrary([load_xml(DOCUMENT, 'groot2.xml', registry())])
HEADER = request_header(RequestType.STATUS, 7)


def ask(server: Groot2Server, type: int, *content: bytes) -> list[bytes]:
    return server.answer([HEADER[:1] + bytes((type,)) + HEADER[2:], *content])


def tree(id: str = 'One', board: Blackboard | None = None) -> Tree:
    return Tree(LIBRARY, id, blackboard=board, clock=ManualClock())


def observed(server: Groot2Server, shown: Tree) -> WatchedTree:
    log = LogBuffer(clock)
    watched = server.add(shown, log)
    assert watched is not None
    shown.observe(StatusLog(log), after_round=watched.settle)
    return watched


def breakpoint(uid: int, **changes: Any) -> bytes:
    hook = {'enabled': True, 'uid': uid, 'mode': 0, 'once': False, 'desired_status': 'SKIPPED', 'position': 0}
    return json.dumps(hook | changes).encode()


@pytest.fixture
def server() -> Iterator[Groot2Server]:
    with Groot2Server(free_pair()) as opened:
        yield opened


@pytest.fixture(scope='module')
def fuzzed() -> Iterator[Groot2Server]:
    with Groot2Server(free_pair()) as opened:
        observed(opened, tree())
        yield opened


JSON = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.sampled_from(['SUCCESS', 'IDLE', 'x', '']),
    lambda inner: st.lists(inner) | st.dictionaries(st.sampled_from(['a', 'uid']), inner),
)
HOOKS = st.fixed_dictionaries(
    {},
    optional={
        'enabled': st.booleans() | JSON,
        'uid': st.integers(-1, 9) | JSON,
        'mode': st.integers(-1, 3) | JSON,
        'once': st.booleans() | JSON,
        'desired_status': st.sampled_from(['SUCCESS', 'FAILURE', 'SKIPPED', 'RUNNING', 'IDLE', 'NONE']) | JSON,
        'position': st.integers(-1, 3) | JSON,
        'remove_when_done': st.booleans() | JSON,
    },
)
CONTENT = st.binary() | (HOOKS | st.lists(HOOKS, max_size=3) | JSON).map(lambda item: json.dumps(item).encode())
HEADERS = st.binary(max_size=8) | st.builds(
    lambda type, rest: b'\2' + bytes((type,)) + rest,
    st.sampled_from(list(RequestType)) | st.integers(0, 255),
    st.binary(min_size=4, max_size=4),
)


@given(st.lists(st.tuples(HEADERS, st.lists(CONTENT, max_size=2)), min_size=1, max_size=6))
def test_any_request_has_a_reply_and_hurts_nothing(
    fuzzed: Groot2Server, requests: list[tuple[bytes, list[bytes]]]
) -> None:
    for header, content in requests:
        reply = fuzzed.answer([header, *content])
        assert 1 <= len(reply) <= 2
        assert reply[-1] != b'Unknown error while processing request'  # that would be a fault of the server
        assert reply[0] == b'error' or (len(header) == 6 and reply[0][1:6] == header[1:] and len(reply[0]) == 22)
    for hook in json.loads(ask(fuzzed, RequestType.HOOKS_DUMP)[1]):
        assert 1 <= hook['uid'] <= 7
    assert len(ask(fuzzed, RequestType.STATUS)[1]) == 3 * 7
    ask(fuzzed, RequestType.REMOVE_ALL_HOOKS)


@pytest.mark.parametrize(
    ('type', 'content', 'text'),
    [
        # The texts of BehaviorTree.CPP 4.10 and of its JSON library; 4.8.2 ends the process instead.
        ('I', b'{"uid": 1, "position": 0}', "[json.exception.out_of_range.403] key 'enabled' not found"),
        ('I', b'{"uid": 1, "desired_status": "x"}', "[json.exception.out_of_range.403] key 'position' not found"),
        ('R', b'{"position": 0}', "[json.exception.out_of_range.403] key 'uid' not found"),
        ('R', b'{"uid": "1"}', '[json.exception.type_error.302] type must be number, but is string'),
        ('R', b'[]', '[json.exception.type_error.304] cannot use at() with array'),
        ('R', b'null', '[json.exception.type_error.304] cannot use at() with null'),
        ('U', b'{"uid": 1, "desired_status": 2}', '[json.exception.type_error.302] type must be string, but is number'),
        ('I', breakpoint(1, enabled=1), '[json.exception.type_error.302] type must be boolean, but is number'),
        ('I', breakpoint(1, desired_status='NONE'), 'Cannot convert this to NodeStatus: NONE'),
        ('R', breakpoint(7), 'Node ID not found'),
        ('U', breakpoint(7, remove_when_done=True), 'Node ID not found'),
        ('R', b'{"uid": 1e999}', "[json.exception.out_of_range.406] number overflow parsing '1e999'"),
    ],
)
def test_what_is_wrong_is_said(server: Groot2Server, type: str, content: bytes, text: str) -> None:
    observed(server, tree())
    assert ask(server, ord(type), content) == [b'error', text.encode()]
    assert ask(server, ord('I'), b'{,}')[1].startswith(
        b'[json.exception.parse_error.101] parse error at line 1, column 2'
    )


def test_bytes_that_are_no_messages_do_not_reach_others(server: Groot2Server) -> None:
    """A client that speaks no ZeroMQ, one that goes without its reply, and one whose request is too large."""
    port = free_pair()
    with Groot2Server(port) as opened, zmq.Context() as context:
        observed(opened, tree())
        for rubbish in (b'GET / HTTP/1.1\r\n\r\n', b'\xff' * 100, b'\xff\0\0\0\0\0\0\0\1\x7f\3\0NULL', b''):
            with socket.create_connection(('127.0.0.1', port)) as raw:
                raw.sendall(rubbish)
        for request in ([HEADER], [HEADER, b'x' * 2_000_000], [b''] * 50, [b'x', b'', HEADER]):
            with context.socket(zmq.DEALER) as dealer:
                dealer.set(zmq.LINGER, 1000)
                dealer.connect(f'tcp://127.0.0.1:{port}')
                dealer.send_multipart([b'', *request])
        with context.socket(zmq.REQ) as client:
            client.set(zmq.RCVTIMEO, int(DEADLINE * 1000))
            client.connect(f'tcp://127.0.0.1:{port}')
            client.send(HEADER)
            header, statuses = client.recv_multipart()
            assert header[:6] == HEADER
            assert len(statuses) == 3 * 7


def test_a_port_that_is_taken_is_an_error() -> None:
    port = free_pair()
    with socket.create_server(('127.0.0.1', port + 1)), pytest.raises(OSError, match=f'{port + 1}.*Groot2'):
        Groot2Server(port)
    with Groot2Server(port):
        pass


def shown_tree(server: Groot2Server) -> bytes:
    return ask(server, RequestType.STATUS)[0][6:]


def test_the_newest_tree_is_shown(server: Groot2Server) -> None:
    assert ask(server, RequestType.FULL_TREE) == [b'error', b'no tree has been started yet']
    first = observed(server, tree('One'))
    second = observed(server, tree('Two'))
    assert shown_tree(server) == second.uuid != first.uuid
    assert b'ID="One"' not in ask(server, RequestType.FULL_TREE)[1]
    server.remove(second)
    assert shown_tree(server) == first.uuid
    server.remove(first)
    assert shown_tree(server) == first.uuid
    third = observed(server, tree('Two'))
    assert shown_tree(server) == third.uuid


def test_only_one_tree_is_shown_if_asked_for() -> None:
    with Groot2Server(free_pair(), only='Two') as server:
        assert server.add(tree('One'), LogBuffer(clock)) is None
        assert ask(server, RequestType.STATUS)[0] == b'error'
        two = observed(server, tree('Two'))
        assert shown_tree(server) == two.uuid


class Held:
    """A tree whose tick a breakpoint holds up."""

    def __init__(self, server: Groot2Server, shown: Tree, uid: int) -> None:
        self.news: list[bool] = []
        self.arrived = threading.Event()
        log = LogBuffer(clock)
        watched = server.add(shown, log, self._on_held)
        assert watched is not None
        self.watched = watched
        shown.observe(StatusLog(log), after_round=watched.settle)
        ask(server, RequestType.HOOK_INSERT, breakpoint(uid))
        self.result: list[Any] = []
        self.thread = threading.Thread(target=self._tick, args=(shown,))
        self.thread.start()
        assert self.arrived.wait(DEADLINE)

    def _on_held(self, held: bool) -> None:
        self.news.append(held)
        if held:
            self.arrived.set()

    def _tick(self, shown: Tree) -> None:
        self.result.append(shown.tick_once())

    def goes_on(self) -> Any:
        self.thread.join(DEADLINE)
        assert self.news == [True, False]
        return self.result[0]


def test_a_tree_that_is_held_stays_and_holds_no_other(server: Groot2Server) -> None:
    held = Held(server, tree('One'), 3)
    other = tree('One')
    watched = observed(server, other)
    assert other.tick_once() is NodeStatus.SUCCESS
    assert shown_tree(server) == held.watched.uuid
    ask(server, RequestType.BREAKPOINT_UNLOCK, breakpoint(3, desired_status='FAILURE', remove_when_done=True))
    assert held.goes_on() is NodeStatus.FAILURE
    assert shown_tree(server) == held.watched.uuid
    server.remove(held.watched)
    assert shown_tree(server) == watched.uuid


def test_a_hidden_tree_is_not_held(server: Groot2Server) -> None:
    one = tree('One')
    observed(server, one)
    ask(server, RequestType.HOOK_INSERT, breakpoint(2))
    observed(server, tree('Two'))
    assert one.tick_once() is NodeStatus.SUCCESS


def test_the_end_of_the_server_lets_go() -> None:
    with Groot2Server(free_pair()) as server:
        held = Held(server, tree(), 1)
    assert held.goes_on() is NodeStatus.SUCCESS


def test_a_request_during_the_end_of_the_server_holds_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    port, shown = free_pair(), tree()
    with zmq.Context() as context, context.socket(zmq.REQ) as client:
        client.connect(f'tcp://127.0.0.1:{port}')
        with Groot2Server(port) as server:
            observed(server, shown)
            ask(server, RequestType.HOOK_INSERT, breakpoint(1))
            stop = server._stop.send

            def ask_and_stop(data: bytes) -> None:
                client.send(HEADER)
                client.recv_multipart()
                stop(data)

            monkeypatch.setattr(server, '_stop', SimpleNamespace(send=ask_and_stop))
    ticking = threading.Thread(target=shown.tick_once, daemon=True)
    ticking.start()
    ticking.join(DEADLINE)
    assert not ticking.is_alive()


def test_hooks_are_handed_on_to_the_next_run_of_the_tree(server: Groot2Server) -> None:
    one = observed(server, tree())
    ask(server, RequestType.HOOK_INSERT, breakpoint(3, mode=1, desired_status='FAILURE', position=1))
    server.remove(one)
    again = tree()
    observed(server, again)
    assert again.tick_once() is NodeStatus.FAILURE
    observed(server, tree('Two'))
    assert ask(server, RequestType.HOOKS_DUMP)[1] == b'[]'


def test_hooks_after_ticks(server: Groot2Server) -> None:
    """Both at one node, by their positions; the library of the wheel makes hooks before ticks of all."""
    shown = tree()
    observed(server, shown)
    ask(server, RequestType.HOOK_INSERT, b'[%s,%s]' % (breakpoint(3, mode=1), breakpoint(3, mode=1, position=1)))
    assert [hook['position'] for hook in json.loads(ask(server, RequestType.HOOKS_DUMP)[1])] == [0, 1]
    ask(server, RequestType.HOOK_REMOVE, b'{"uid": 3, "position": 0}')
    ask(server, RequestType.HOOK_INSERT, breakpoint(3, mode=1, position=1, once=True, desired_status='FAILURE'))
    assert shown.tick_once() is NodeStatus.FAILURE
    assert ask(server, RequestType.HOOKS_DUMP)[1] == b'[]'
    assert shown.tick_once() is NodeStatus.SUCCESS


def test_a_recording_keeps_the_newest(server: Groot2Server) -> None:
    shown = tree()
    observed(server, shown)
    ask(server, RequestType.TOGGLE_RECORDING, b'start')
    rounds = RECORDED // 14 + 20
    for _ in range(rounds):
        shown.tick_once()
    kept = ask(server, RequestType.GET_TRANSITIONS)[1]
    assert len(kept) == 9 * RECORDED
    # The last of them is that the root is IDLE again.
    assert kept[-3:] == b'\1\0\0'
    assert ask(server, RequestType.GET_TRANSITIONS)[1] == b''


def test_a_run_adds_nothing_to_a_recording_while_a_client_reads_it(server: Groot2Server) -> None:
    watched = observed(server, tree())
    ask(server, RequestType.TOGGLE_RECORDING, b'start')
    held: list[str] = []

    class Reading(contextlib.AbstractContextManager[None]):
        def __enter__(self) -> None:
            held.append('begin')

        def __exit__(self, *_: object) -> None:
            held.append('end')

    class Recorded(deque[tuple[int, int, int]]):
        def __iter__(self) -> Iterator[tuple[int, int, int]]:
            held.append('copy')
            return super().__iter__()

        def clear(self) -> None:
            held.append('clear')
            super().clear()

    watched._reading, watched._recorded = Reading(), Recorded([(1, 1, 1)])  # type: ignore[assignment]
    assert len(ask(server, RequestType.GET_TRANSITIONS)[1]) == 9
    assert ' '.join(held).endswith('copy clear end')


def test_the_topmost_blackboard_comes_with_others(server: Groot2Server) -> None:
    outer = Blackboard()
    outer.set('far', [1 << 70])
    shown = tree(board=Blackboard(outer))
    observed(server, shown)
    shown.tick_once()
    replies = [msgpack.unpackb(ask(server, RequestType.BLACKBOARD, names)[1]) for names in (b'One', b'two;One', b'x')]
    assert replies[0] == {'One': {'x': 1}, 'ROOT': {'far': [str(1 << 70)]}}
    assert replies[1] == {**replies[0], 'two': {'y': 1}}
    assert replies[2] is None


def test_a_blackboard_that_is_asked_for_again_and_again_is_shown_once(
    server: Groot2Server, monkeypatch: pytest.MonkeyPatch
) -> None:
    shown = tree()
    observed(server, shown)
    shown.tick_once()
    shows: list[Blackboard] = []
    show = WatchedTree._shown

    def count(watched: WatchedTree, board: Blackboard) -> dict[str, Any] | None:
        shows.append(board)
        return show(watched, board)

    monkeypatch.setattr(WatchedTree, '_shown', count)
    (_, reply) = ask(server, RequestType.BLACKBOARD, b';'.join([b'One', b'two'] * 100_000))
    assert msgpack.unpackb(reply) == {'One': {'x': 1}, 'two': {'y': 1}, 'ROOT': {'x': 1}}
    assert len(shows) == 3


def test_a_program_shows_a_tree(server: Groot2Server) -> None:
    """Statuses that are asked for late are those of the end, each change on the way counted."""
    shown = tree()
    with server.watch(shown):
        for _ in range(500):
            assert shown.tick_once() is NodeStatus.SUCCESS
    assert ask(server, RequestType.STATUS)[1][2::3] == bytes([12] * 7)


def test_requests_of_any_moment_lose_nothing(server: Groot2Server) -> None:
    """While the tree is ticked: the statuses at the end, and what was recorded, are those of every change, in order."""
    shown = tree()
    watched = observed(server, shown)
    over = threading.Event()
    records: list[bytes] = []

    def request() -> None:
        chance = random.Random(1)
        ask(server, RequestType.TOGGLE_RECORDING, b'start')
        while not over.is_set():
            match chance.choice('IRADSttt'):
                case 'I':
                    hook = breakpoint(
                        chance.randrange(1, 8), mode=1, once=chance.random() < 0.5, position=chance.randrange(2)
                    )
                    ask(server, RequestType.HOOK_INSERT, hook)
                case 'R':
                    ask(
                        server,
                        RequestType.HOOK_REMOVE,
                        breakpoint(chance.randrange(1, 8), position=chance.randrange(2)),
                    )
                case 't':
                    records.append(ask(server, RequestType.GET_TRANSITIONS)[1])
                case choice:
                    assert ask(server, ord(choice))[0] != b'error'

    thread = threading.Thread(target=request)
    thread.start()
    ticks = 0
    while ticks < 300 or len(records) < 100:
        assert shown.tick_once() is NodeStatus.SUCCESS
        ticks += 1
    over.set()
    thread.join(DEADLINE)
    ask(server, RequestType.REMOVE_ALL_HOOKS)
    assert shown.tick_once() is NodeStatus.SUCCESS
    assert ask(server, RequestType.STATUS)[1][2::3] == bytes([12] * 7)
    records.append(ask(server, RequestType.GET_TRANSITIONS)[1])
    if all(len(part) < 9 * RECORDED for part in records):
        data = b''.join(records)
        statuses: dict[int, list[int]] = {}
        for at in range(0, len(data), 9):
            statuses.setdefault(data[at + 6], []).append(data[at + 8])
        # A leaf is IDLE, then SUCCESS; all others are RUNNING in between. The recording may begin in the middle.
        for uid, seen in statuses.items():
            cycle = [0, 2] if uid in (2, 3, 6, 7) else [0, 1, 2]
            start = cycle.index(seen[0])
            assert seen == [cycle[(start + step) % len(cycle)] for step in range(len(seen))], uid
    assert watched.breakpoints.all() == []


class Twice(ExpandingAction):
    """Has the tree Two made below it two times."""

    def on_start(self) -> NodeStatus:
        return self.expand(LIBRARY, 'Two', self.board())

    def on_running(self) -> NodeStatus:
        if self.tick_tree() is NodeStatus.RUNNING:
            return NodeStatus.RUNNING
        return NodeStatus.SUCCESS if self.blackboard.get_or('again', False) else self.begin_again()

    def begin_again(self) -> NodeStatus:
        self.blackboard.set('again', True)
        return self.expand(LIBRARY, 'Two', self.board())

    def board(self) -> Blackboard:
        board = Blackboard(self.blackboard)
        board.set('x', 5)
        return board

    def on_halted(self) -> None: ...


def expanding() -> Tree:
    known = registry()
    known.register('Twice', Twice)
    body = '<BehaviorTree ID="Top"><Sequence><AlwaysSuccess/><Twice/></Sequence></BehaviorTree>'
    document = load_xml(f'<root BTCPP_format="4">{body}</root>', 'top.xml', known)
    return Tree(TreeLibrary([document]), 'Top', clock=ManualClock())


def test_a_tree_that_gets_other_nodes_is_another_one_with_the_same_hooks(server: Groot2Server) -> None:
    shown = expanding()
    with server.watch(shown):
        before = shown_tree(server)
        hook = breakpoint(2, mode=1, desired_status='SUCCESS')
        ask(server, RequestType.HOOK_INSERT, hook)
        assert shown.tick_exactly_once() is NodeStatus.RUNNING
        assert shown.tick_exactly_once() is NodeStatus.RUNNING
        assert shown_tree(server) != before
        (shown_as,) = ask(server, RequestType.FULL_TREE)[1:]
        assert b'<SubTree ID="Two" _fullpath="Twice::3" _uid="3"/>' in shown_as
        assert b'<BehaviorTree ID="Two" _fullpath="Twice::3">' in shown_as
        inner = breakpoint(4, mode=1, desired_status='SUCCESS')
        ask(server, RequestType.HOOK_INSERT, inner)
        assert [one['uid'] for one in json.loads(ask(server, RequestType.HOOKS_DUMP)[1])] == [2, 4]
        assert shown.tick_once() is NodeStatus.SUCCESS
        # That of the node which is there no more has gone.
        assert [one['uid'] for one in json.loads(ask(server, RequestType.HOOKS_DUMP)[1])] == [2]
        assert len(ask(server, RequestType.STATUS)[1]) == 3 * len(shown.nodes)
        boards = msgpack.unpackb(ask(server, RequestType.BLACKBOARD, b'Twice::3')[1])
        assert boards['Twice::3']['y'] == 5


def test_a_request_that_comes_late_for_what_was_there_before_changes_nothing(server: Groot2Server) -> None:
    """It has found its tree, and the tree has had other nodes since."""
    shown, log = expanding(), LogBuffer(clock)
    watched = [server.add(shown, log)]
    first = watched[0]
    assert first is not None

    def expanded() -> None:
        assert watched[-1] is not None
        watched.append(server.expanded(watched[-1]))
        first.breakpoints.insert(json.loads(breakpoint(2, mode=1, desired_status='FAILURE')))
        first.toggle_recording(b'start')

    shown.observe(StatusLog(log), on_expanded=expanded)
    assert shown.tick_exactly_once() is NodeStatus.RUNNING
    before = first.statuses()
    assert shown.tick_once() is NodeStatus.SUCCESS
    assert len(watched) == 3
    assert (first.statuses(), first.breakpoints.dump(), log.timed) == (before, '[]', False)
    assert ask(server, RequestType.STATUS)[1][2::3] == bytes([12] * len(shown.nodes))


def test_a_log_file_has_the_nodes_with_which_it_began(tmp_path: Path) -> None:
    shown, log = expanding(), LogBuffer(clock, timed=True)
    steps: list[Callable[[], None]] = []
    LogWriter(tmp_path / 'x.btlog', shown, log, clock(), 0.0, write=steps.append, on_error=pytest.fail)
    shown.observe(StatusLog(log))
    paths = [node.path for node in shown.nodes]
    assert shown.tick_once() is NodeStatus.SUCCESS and len(shown.nodes) > len(paths)
    for step in steps:
        step()
    assert [node.path for _, node in sorted(read_log(tmp_path / 'x.btlog').nodes.items())] == paths


def test_a_tree_that_is_not_shown_keeps_its_observers() -> None:
    shown = tree()
    heard: list[int] = []
    shown.observe(StatusLog(heard))
    with Groot2Server(free_pair(), only='Two') as server, server.watch(shown):
        pass
    assert shown.tick_once() is NodeStatus.SUCCESS and heard
