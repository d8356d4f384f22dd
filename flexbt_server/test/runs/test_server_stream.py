# SPDX-License-Identifier: BSD-3-Clause
"""The stream of tree statuses, as another node gets it: whole, in order, bounded, and joined at any time."""

from __future__ import annotations

import contextlib
import random
import struct
import threading
import time
import tracemalloc
from array import array
from collections.abc import Callable, Iterator
from functools import partial
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from rclpy.serialization import deserialize_message, serialize_message
from rclpy.time import Time

from flexbt_common import names
from flexbt_common.calls.action_call import GoalStatus
from flexbt_common.runtime.node_runtime import NodeRuntime
from flexbt_core.behavior_tree.engine.observers import StatusLog
from flexbt_core.behavior_tree.engine.tree import Tree
from flexbt_core.behavior_tree.model.blackboard import Blackboard
from flexbt_core.behavior_tree.model.errors import NodeExecutionError
from flexbt_core.behavior_tree.model.status import SUCCESS, NodeStatus
from flexbt_core.clock.clock import Timer
from flexbt_msgs.msg import TreeNode, TreeStatus, TreeStatusChange, TreeStructure
from flexbt_server.runs.run_events import RoundEnded, RunEnded, RunEvents, RunOutcome, RunPaused, RunStarted
from flexbt_server.runs.tree_stream import (
    BATCH_SECONDS,
    MAX_CHANGES,
    MAX_MARKS,
    MESSAGES_KEPT,
    RoundReader,
    RunStream,
    TreeStream,
    encoded,
    serialized,
)
from flexbt_testing.behavior_trees.user_node_trees import make, random_body, run_some
from flexbt_testing.nodes.server_world import open_server_world
from flexbt_testing.waiting import DEADLINE, held, wait_until

Changes = list[tuple[int, int, int]]
SLEEP = '<Sleep msec="1000000"/>'


class Watched:
    """A tree on a stream, and what an observer within hears of it."""

    def __init__(self, stream: TreeStream, run_id: str, body: str) -> None:
        board = Blackboard()
        board.set('n', 1)
        self.run: RunStream = stream.open(RunEvents(run_id, 'board'))
        self.heard: Changes = []
        self.tree: Tree = make(body, blackboard=board)
        self.tree.observe(
            StatusLog(self.run.log),
            lambda node, before, after: self.heard.append((node.uid, before, after)),
            after_round=lambda: self.run.read(RoundEnded()),
        )
        self.run.read(RunStarted(self.tree))

    def end(self) -> None:
        with contextlib.suppress(NodeExecutionError):
            self.tree.halt()
        self.run.read(RunEnded(RunOutcome(0)))


class Subscriber:
    """A node that keeps what it gets; it is made objects of only when somebody looks."""

    def __init__(self, runtime: NodeRuntime, depth: int = 5000) -> None:
        self._received: dict[Any, list[Any]] = {TreeStructure: [], TreeStatus: []}

        def subscribe() -> list[Any]:
            return [
                runtime.node.create_subscription(
                    kind, name, self._received[kind].append, names.transient_local_qos(depth), raw=True
                )
                for kind, name in ((TreeStructure, names.TREE_STRUCTURE), (TreeStatus, names.TREE_STATUS))
            ]

        self._runtime, self._subscriptions = runtime, runtime.call(subscribe)

    def leave(self) -> None:
        for one in self._subscriptions:
            self._runtime.call(partial(self._runtime.node.destroy_subscription, one))

    def _objects(self, kind: Any) -> list[Any]:
        received = self._received[kind]
        for index, message in enumerate(received):
            if isinstance(message, bytes):
                received[index] = deserialize_message(message, kind)
        return list(received)

    @property
    def structures(self) -> list[TreeStructure]:
        return self._objects(TreeStructure)

    @property
    def messages(self) -> list[TreeStatus]:
        return self._objects(TreeStatus)

    @property
    def count(self) -> int:
        """Messages with statuses that have come."""
        return len(self._received[TreeStatus])

    def of(self, run_id: str) -> list[TreeStatus]:
        return [message for message in self.messages if message.run_id == run_id]

    def await_end(self, *run_ids: str) -> None:
        for run_id in run_ids:
            wait_until(lambda: any(message.finished for message in self.of(run_id)), f'the end of {run_id}')  # noqa: B023


@pytest.fixture
def server() -> Iterator[NodeRuntime]:
    with NodeRuntime.open('server') as runtime:
        yield runtime


@pytest.fixture
def monitor() -> Iterator[NodeRuntime]:
    with NodeRuntime.open('monitor') as runtime:
        yield runtime


def changes_of(messages: list[TreeStatus]) -> Changes:
    return [(change.uid, change.previous_status, change.status) for message in messages for change in message.changes]


def check_whole(messages: list[TreeStatus], heard: Changes, size: int) -> None:
    """Nothing is lost, nothing is twice, and the picture fits after each message."""
    assert [message.sequence for message in messages] == list(range(1, len(messages) + 1))
    assert changes_of(messages) == heard
    shown = [0] * size
    stamps = []
    for message in messages:
        assert len(message.changes) <= MAX_CHANGES
        for change in message.changes:
            assert shown[change.uid - 1] == change.previous_status
            shown[change.uid - 1] = change.status
            stamps.append((change.stamp.sec, change.stamp.nanosec))
        assert list(message.statuses) == shown
    assert stamps == sorted(stamps)
    assert [message.finished for message in messages] == [False] * (len(messages) - 1) + [True]


def test_random_trees_reach_a_subscriber_whole_and_in_order(server: NodeRuntime, monitor: NodeRuntime) -> None:
    stream, subscriber = TreeStream(server), Subscriber(monitor)
    watched = {str(seed): Watched(stream, str(seed), random_body(seed)) for seed in range(40)}
    for step in range(25):
        for run_id, each in watched.items():
            run_some(each.tree, int(run_id) * 100 + step)
        time.sleep(BATCH_SECONDS / 10)
        # More than are kept would be lost, also before the subscriber is known.
        sent = sum(each.run._sequence for each in watched.values())
        wait_until(lambda: sent < subscriber.count + MESSAGES_KEPT - len(watched), 'the subscriber')  # noqa: B023
    for each in watched.values():
        each.end()
    subscriber.await_end(*watched)
    for run_id, each in watched.items():
        check_whole(subscriber.of(run_id), each.heard, len(each.tree.nodes))
    assert sum(len(each.heard) for each in watched.values()) > 1000
    assert {structure.run_id for structure in subscriber.structures} == watched.keys()
    for structure in subscriber.structures:
        tree = watched[structure.run_id].tree
        parents = {child: node for node in tree.nodes for child in node.attached}
        assert [
            (node.uid, node.parent, node.kind, node.name, node.registration, node.path) for node in structure.nodes
        ] == [
            (
                node.uid,
                parents[node].uid if node in parents else 0,
                getattr(TreeNode, node.kind.name),
                node.name,
                node.id,
                node.path,
            )
            for node in tree.nodes
        ]
        assert all(node.parent < node.uid for node in structure.nodes)  # the console takes nothing else


@pytest.mark.parametrize('seed', range(5))
def test_whoever_loses_messages_has_the_whole_picture_with_the_next(
    server: NodeRuntime, monitor: NodeRuntime, seed: int
) -> None:
    stream, subscriber = TreeStream(server), Subscriber(monitor)
    watched = Watched(stream, 'run', random_body(seed))
    for step in range(30):
        run_some(watched.tree, seed * 1000 + step)
        watched.run._flush()
    watched.end()
    subscriber.await_end('run')
    chance = random.Random(seed)
    expected = 1
    whole = [0] * len(watched.tree.nodes)
    lossy = list(whole)
    for message in subscriber.of('run'):
        for change in message.changes:
            whole[change.uid - 1] = change.status
        if chance.random() < 0.4:
            continue
        if message.sequence != expected:
            lossy = list(message.statuses)
        else:
            for change in message.changes:
                assert lossy[change.uid - 1] == change.previous_status
                lossy[change.uid - 1] = change.status
        expected = message.sequence + 1
        assert lossy == whole
    assert whole == [0] * len(watched.tree.nodes)


def quiet_for_long(stream: TreeStream, body: str) -> Watched:
    """Return a run that has been paused for so long that the middleware keeps only messages of others."""
    quiet = Watched(stream, 'quiet', body)
    quiet.tree.tick_once()
    quiet.run.read(RunPaused(True))
    for number in range(MESSAGES_KEPT + 1):
        other = Watched(stream, f'other {number}', SLEEP)
        other.tree.tick_once()
        other.end()
    return quiet


def test_who_comes_late_sees_every_open_run_at_once(server: NodeRuntime, monitor: NodeRuntime) -> None:
    """Also those that have been quiet for so long that the middleware has forgotten them."""
    quiet = quiet_for_long(TreeStream(server), f'<Sequence><AlwaysSuccess/>{SLEEP}</Sequence>')
    subscriber = Subscriber(monitor)
    wait_until(lambda: subscriber.of('quiet') and [each for each in subscriber.structures if each.run_id == 'quiet'])
    (message,) = subscriber.of('quiet')
    assert list(message.statuses) == [1, 2, 1]
    assert message.paused and not message.finished and not message.changes
    quiet.end()
    subscriber.await_end('quiet')
    assert changes_of(subscriber.of('quiet')) == quiet.heard[-3:]
    assert len(subscriber.of(f'other {MESSAGES_KEPT}')) >= 1  # what the middleware had kept


def test_who_comes_as_another_leaves_sees_every_open_run(server: NodeRuntime, monitor: NodeRuntime) -> None:
    """Also if the server hears of both at once, since it was busy."""
    stream, first = TreeStream(server), Subscriber(monitor)
    quiet_for_long(stream, SLEEP)
    first.await_end(f'other {MESSAGES_KEPT}')
    with held(server):
        first.leave()
        wait_until(lambda: server.node.count_subscribers(names.TREE_STATUS) == 0, 'the first one has left')
        second = Subscriber(monitor)
        wait_until(lambda: server.node.count_subscribers(names.TREE_STATUS) == 1, 'the second one')
    wait_until(lambda: second.of('quiet'), 'the quiet run')


def test_nothing_is_sent_while_nothing_happens(server: NodeRuntime, monitor: NodeRuntime) -> None:
    stream, subscriber = TreeStream(server), Subscriber(monitor)
    watched = Watched(stream, 'run', f'<ReactiveSequence><Inverter>{SLEEP}</Inverter></ReactiveSequence>')
    for _ in range(100):
        watched.tree.tick_once()
        time.sleep(BATCH_SECONDS / 20)
    watched.end()
    subscriber.await_end('run')
    # One more when the subscriber was found only after the first.
    assert [len(message.changes) for message in subscriber.of('run') if message.changes] == [3, 3]
    assert len(subscriber.of('run')) <= 3


def test_the_first_change_of_a_quiet_time_is_sent_at_once_and_others_wait(
    server: NodeRuntime, monitor: NodeRuntime
) -> None:
    stream, subscriber = TreeStream(server), Subscriber(monitor)
    watched = Watched(stream, 'run', '<KeepRunningUntilFailure><AlwaysSuccess/></KeepRunningUntilFailure>')
    began = time.monotonic()
    while len(subscriber.of('run')) < 6:
        assert time.monotonic() - began < DEADLINE
        watched.tree.tick_exactly_once()
        time.sleep(0.002)
    wait_until(lambda: changes_of(subscriber.of('run')) == watched.heard, 'what waited for its time')
    assert len(subscriber.of('run')) <= 3 + (time.monotonic() - began) / BATCH_SECONDS
    watched.end()
    subscriber.await_end('run')
    check_whole(subscriber.of('run'), watched.heard, 2)


def test_a_flush_that_comes_before_its_timer_is_known_stops_nothing(
    server: NodeRuntime, monitor: NodeRuntime, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The thread that ticks is stopped for a moment as soon as the clock knows when to send."""
    call_at, flushed = server.steady.call_at, threading.Event()

    def call_late(when: float, callback: Callable[[], None]) -> Timer:
        def call() -> None:
            try:
                callback()
            finally:
                flushed.set()

        flushed.clear()
        timer = call_at(when, call)
        flushed.wait(4 * BATCH_SECONDS)
        return timer

    monkeypatch.setattr(server.steady, 'call_at', call_late)
    stream, subscriber = TreeStream(server), Subscriber(monitor)
    watched = Watched(stream, 'run', '<KeepRunningUntilFailure><AlwaysSuccess/></KeepRunningUntilFailure>')
    for _ in range(3):
        watched.tree.tick_exactly_once()
        wait_until(lambda: changes_of(subscriber.of('run')) == watched.heard, 'what was ticked')
    watched.end()


def test_a_tree_that_changes_all_the_time_is_sent_whole_and_little_waits(
    server: NodeRuntime, monitor: NodeRuntime
) -> None:
    """One tick of 120 rounds: faster than any subscriber."""
    stream, subscriber = TreeStream(server), Subscriber(monitor)
    leaves = '<AlwaysSuccess/>' * 300
    watched = Watched(stream, 'run', f'<Repeat num_cycles="120"><Sequence>{leaves}</Sequence></Repeat>')
    waiting: list[int] = []

    def round_is_over() -> None:
        waiting.append(len(watched.run.log))
        watched.run.read(RoundEnded())

    # Another observer takes longer than all the rest.
    watched.tree.observe(StatusLog(watched.run.log), after_round=round_is_over)
    assert watched.tree.tick_once() is NodeStatus.SUCCESS
    watched.end()
    subscriber.await_end('run')
    total = 120 * (2 * 300 + 3) + 3 - 1
    changes = changes_of(subscriber.of('run'))
    assert abs(len(changes) - total) < 1000
    assert max(waiting) < MAX_MARKS + 2 * 300 + 4  # and a round, since another thread may send a part of one
    check_whole(subscriber.of('run'), changes, len(watched.tree.nodes))


def test_a_server_that_is_not_to_publish_watches_nothing() -> None:
    with open_server_world(publish_statuses=False) as world:
        world.navigation.hold.add(names.SPIN)
        world.client.load_tree('<Sequence><AlwaysSuccess/><Spin/></Sequence>')
        goal = world.client.execute()
        wait_until(lambda: goal.feedback and goal.feedback[-1].active_nodes, 'the running tree')
        (run,) = (running.run for running in world.server.goals.running.on(''))
        assert run.tree is not None
        assert run.tree.observers == ()
        assert world.client.runtime.node.count_publishers(names.TREE_STATUS) == 0
        world.navigation.actions[names.SPIN].end(0)
        assert goal.wait().status is GoalStatus.SUCCEEDED


def test_marks_can_be_sent_while_another_thread_ticks_the_tree(server: NodeRuntime, monitor: NodeRuntime) -> None:
    stream, subscriber = TreeStream(server), Subscriber(monitor)
    watched = Watched(
        stream,
        'run',
        '<Careless><Repeat num_cycles="3"><Busy/></Repeat><Fickle><Flip/><Busy/></Fickle>'
        '<ReactiveFallback><Flip/><Flip/><Busy/></ReactiveFallback></Careless>',
    )
    done = threading.Event()

    def tick() -> None:
        for _ in range(1500):
            watched.tree.tick_exactly_once()
        done.set()

    thread = threading.Thread(target=tick)
    thread.start()
    while not done.is_set():
        watched.run._flush()
        # A subscriber that is more behind than the middleware keeps would lose messages.
        wait_until(lambda: watched.run._sequence < subscriber.count + MESSAGES_KEPT // 2, 'the subscriber')
    thread.join()
    watched.end()
    subscriber.await_end('run')
    check_whole(subscriber.of('run'), watched.heard, len(watched.tree.nodes))


def test_a_round_that_ends_while_its_first_marks_are_sent_is_stamped_in_order(
    server: NodeRuntime, monitor: NodeRuntime, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The thread that sends is stopped for a moment between the marks it takes and its look at the clock."""
    stream, subscriber = TreeStream(server), Subscriber(monitor)
    watched = Watched(stream, 'run', '<Sequence><AlwaysSuccess/><AlwaysSuccess/></Sequence>')
    stamp, taken = server.clock.stamp, threading.Event()

    def late() -> Any:
        if not taken.is_set():
            taken.set()
            wait_until(lambda: any(mark < 0 for mark in watched.run.log), 'the end of the round')
        return stamp()

    def send(*_: object) -> None:
        if not sender.ident:
            sender.start()
            assert taken.wait(DEADLINE)

    monkeypatch.setattr(server.clock, 'stamp', late)
    sender = threading.Thread(target=watched.run._flush)
    log, hear = watched.tree.observers
    watched.tree.observe(log, hear, send, after_round=lambda: watched.run.read(RoundEnded()))
    watched.tree.tick_exactly_once()
    sender.join()
    watched.end()
    subscriber.await_end('run')
    check_whole(subscriber.of('run'), watched.heard, len(watched.tree.nodes))


def test_stamps_are_in_order_while_the_clock_stands_still_and_follow_it_when_it_is_set_back(
    server: NodeRuntime, monitor: NodeRuntime, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As simulated time does: between two messages of /clock, and when the simulation begins again."""
    stream, subscriber = TreeStream(server), Subscriber(monitor)
    for seconds in (9, 4):
        monkeypatch.setattr(server.clock, 'stamp', lambda: Time(seconds=seconds).to_msg())  # noqa: B023
        if seconds == 9:
            watched = Watched(stream, 'run', '<Sequence><AlwaysSuccess/><AlwaysFailure/></Sequence>')
        for _ in range(10):
            for _ in range(20):
                watched.tree.tick_exactly_once()
            watched.run._flush()
    watched.end()
    subscriber.await_end('run')
    messages = subscriber.of('run')
    assert changes_of(messages) == watched.heard
    for seconds in (9, 4):
        stamps = [
            Time.from_msg(change.stamp).nanoseconds
            for message in messages
            if message.stamp.sec == seconds
            for change in message.changes
        ]
        assert stamps == sorted(stamps)
        assert 0 < stamps[0] <= stamps[-1] <= seconds * 1_000_000_000


def test_a_tree_runs_on_when_its_statuses_cannot_be_sent(server: NodeRuntime) -> None:
    stream = TreeStream(server)
    watched = Watched(stream, 'run', '<Sequence><AlwaysSuccess/><AlwaysFailure/></Sequence>')
    server.call(lambda: server.node.destroy_publisher(stream.statuses))
    for _ in range(MAX_MARKS):
        assert watched.tree.tick_once() is NodeStatus.FAILURE
    assert len(watched.run.log) < MAX_MARKS + 10
    watched.end()
    server.call(lambda: server.node.destroy_publisher(stream.structures))
    another = Watched(stream, 'another', '<AlwaysSuccess/>')
    assert another.tree.tick_once() is NodeStatus.SUCCESS
    another.end()


@settings(deadline=None, max_examples=50)
@given(
    statuses=st.binary(max_size=9),
    run_id=st.text(max_size=9).filter(lambda text: '\0' not in text),
    flags=st.tuples(st.booleans(), st.booleans()),
    changes=st.lists(
        st.tuples(
            st.integers(-(2**31), 2**31 - 1),
            st.integers(0, 10**9 - 1),
            st.integers(1, 65535),
            st.integers(0, 4),
            st.integers(0, 4),
        ),
        max_size=9,
    ),
)
def test_messages_are_what_the_middleware_would_make(
    statuses: bytes, run_id: str, flags: tuple[bool, bool], changes: list[tuple[int, ...]]
) -> None:
    message = TreeStatus(run_id=run_id, sequence=7, finished=flags[0], paused=flags[1], statuses=array('B', statuses))
    parts = [encoded(change[0], change[1], [struct.pack('=HBB', *change[2:])]) for change in changes]
    made = serialized(message, len(changes), parts)
    for seconds, nanoseconds, uid, before, after in changes:
        change: Any = TreeStatusChange(uid=uid, previous_status=before, status=after)
        change.stamp.sec, change.stamp.nanosec = seconds, nanoseconds
        message.changes.append(change)
    # Bytes that pad are whatever was in memory.
    assert len(made) == len(serialize_message(message))
    assert deserialize_message(made, TreeStatus) == message


def test_a_large_tree_whose_rounds_all_differ_costs_little_memory() -> None:
    """Its rounds are remembered with the statuses of all nodes."""
    nodes = make(f'<Sequence>{"<AlwaysSuccess/>" * 3000}</Sequence>').nodes
    reader = RoundReader(nodes)
    tracemalloc.start()
    for node in nodes:
        assert reader.read([node.uid << 4 | SUCCESS]) == [struct.pack('=HBB', node.uid, 0, SUCCESS)]
    size, _ = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert size < 4_000_000
