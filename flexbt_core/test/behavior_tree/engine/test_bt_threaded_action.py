# SPDX-License-Identifier: BSD-3-Clause
"""A leaf that is run in a thread: results, errors, halts at any moment, and no thread left over."""

from __future__ import annotations

import queue
import threading
import time
from collections.abc import Callable, Iterator
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from flexbt_core.behavior_tree.engine.asynchronous_actions import ThreadedAction
from flexbt_core.behavior_tree.engine.leaf import Halted
from flexbt_core.behavior_tree.engine.node import TreeNode
from flexbt_core.behavior_tree.engine.tree import Tree
from flexbt_core.behavior_tree.model.errors import NodeExecutionError
from flexbt_core.behavior_tree.model.ports import INT, output_port
from flexbt_core.behavior_tree.model.status import NodeStatus
from flexbt_core.clock.clock import ManualClock, Timer
from flexbt_testing.behavior_trees.steps import PATIENCE, Woken
from flexbt_testing.behavior_trees.steps import make as make_steps

SUCCESS, FAILURE, RUNNING, SKIPPED = NodeStatus.SUCCESS, NodeStatus.FAILURE, NodeStatus.RUNNING, NodeStatus.SKIPPED


def make(body: str, *node_classes: type[TreeNode], clock: ManualClock | None = None) -> Tree:
    return make_steps(body, clock, extra=node_classes)[0]


@pytest.fixture(autouse=True)
def no_thread_left_over() -> Iterator[None]:
    yield
    deadline = time.monotonic() + PATIENCE
    for thread in threading.enumerate():
        if thread.name.startswith('leaf '):
            thread.join(max(0.0, deadline - time.monotonic()))
            assert not thread.is_alive(), f'{thread.name} is left over'


class Worker(ThreadedAction):
    """Does what it is told through a queue; what it does is seen through another one."""

    ports = {'out': output_port(INT)}

    def __init__(self, config: Any) -> None:
        super().__init__(config)
        self.orders: queue.Queue[Any] = queue.Queue()
        self.reports: queue.Queue[str] = queue.Queue()
        self.at_work = 0
        self.most_at_work = 0
        self.stopped: Callable[[], None] = lambda: None

    def run(self) -> Any:
        self.at_work += 1
        self.most_at_work = max(self.most_at_work, self.at_work)
        self.reports.put('begun')
        try:
            while True:
                order = self.orders.get(timeout=PATIENCE)
                if callable(order):
                    order()
                else:
                    return order
        finally:
            self.at_work -= 1
            self.reports.put('halted' if self.halt_requested else 'ended')

    def on_halted(self) -> None:
        self.stopped()

    def report(self) -> str:
        return self.reports.get(timeout=PATIENCE)


def worker() -> tuple[Tree, Worker, Woken]:
    tree = make('<Worker name="w" out="{x}"/>', Worker)
    leaf = tree.root
    assert isinstance(leaf, Worker)
    return tree, leaf, Woken(tree)


@pytest.mark.parametrize('result', [SUCCESS, FAILURE, SKIPPED])
def test_a_thread_gives_its_result_and_wakes_the_tree(result: NodeStatus) -> None:
    tree, leaf, woken = worker()
    for _ in range(2):
        assert tree.tick_once() is RUNNING
        assert leaf.report() == 'begun'
        assert tree.tick_once() is RUNNING
        leaf.orders.put(lambda: leaf.set_output('out', 7))
        leaf.orders.put(result)
        woken.wait()
        tree.take_wake()
        assert tree.tick_once() is result
        assert leaf.report() == 'ended'
        assert tree.blackboard.get('x') == 7


def test_a_thread_says_why_it_failed() -> None:
    tree, leaf, woken = worker()
    tree.tick_once()
    leaf.orders.put(lambda: leaf.fail('the door is locked'))
    leaf.orders.put(FAILURE)
    woken.wait()
    assert tree.tick_once() is FAILURE
    assert tree.failure is not None
    assert (tree.failure.path, tree.failure.reason) == ('w', 'the door is locked')
    tree.take_wake()
    tree.tick_once()
    leaf.orders.put(FAILURE)
    woken.wait()
    assert tree.tick_once() is FAILURE
    assert tree.failure.reason == 'Worker returned FAILURE', 'the reason was that of the run before'


def test_an_exception_in_a_thread_is_raised_by_the_next_tick_and_the_next_run_is_a_new_one() -> None:
    tree, leaf, woken = worker()
    tree.tick_once()
    leaf.orders.put(lambda: 1 / 0)
    woken.wait()
    with pytest.raises(NodeExecutionError, match=r'\[w\] \(Worker\): ZeroDivisionError') as caught:
        tree.tick_once()
    assert isinstance(caught.value.__cause__, ZeroDivisionError)
    tree.halt()
    assert not tree.unfinished
    assert tree.tick_once() is RUNNING
    leaf.orders.put(SUCCESS)
    woken.wait()
    assert tree.tick_once() is SUCCESS


@pytest.mark.parametrize('nonsense', [None, True, RUNNING, NodeStatus.IDLE])
def test_nonsense_from_a_thread_is_an_error(nonsense: Any) -> None:
    tree, leaf, woken = worker()
    tree.tick_once()
    leaf.orders.put(nonsense)
    woken.wait()
    with pytest.raises(NodeExecutionError, match=r'\[w\]') as caught:
        tree.tick_once()
    unfinished = 'run has to return when the work is done; RUNNING is not a result'
    assert (caught.value.reason == unfinished) is (nonsense is RUNNING)
    tree.halt()


def test_a_halt_does_not_wait_for_the_thread_but_the_tree_says_that_it_is_not_at_rest() -> None:
    tree, leaf, woken = worker()
    tree.tick_once()
    assert leaf.report() == 'begun'
    assert [one.daemon for one in threading.enumerate() if one.name == 'leaf w'] == [True], 'the process may exit'
    tree.halt()
    assert leaf.status is NodeStatus.IDLE
    assert list(tree.unfinished) == ['[w] is coming to its end']
    leaf.orders.put(SUCCESS)
    woken.wait()
    assert leaf.report() == 'halted'
    assert not tree.unfinished


def test_a_thread_that_was_halted_can_write_nothing_any_more() -> None:
    tree, leaf, woken = worker()
    tree.tick_once()
    assert leaf.report() == 'begun'
    tree.halt()
    tree.blackboard.set('x', 1)
    leaf.orders.put(lambda: leaf.set_output('out', 7))
    woken.wait()
    assert leaf.report() == 'halted'
    assert tree.blackboard.get('x') == 1


def test_a_node_that_is_begun_again_waits_for_the_thread_of_before() -> None:
    tree, leaf, woken = worker()
    tree.tick_once()
    assert leaf.report() == 'begun'
    tree.halt()
    assert [tree.tick_once() for _ in range(3)] == [RUNNING] * 3
    tree.halt()
    assert len(tree.unfinished) == 1
    assert tree.tick_once() is RUNNING
    leaf.orders.put(FAILURE)
    woken.wait()
    assert leaf.report() == 'halted'
    # The result of before means nothing; the new call gives its own.
    assert tree.tick_once() is RUNNING
    assert leaf.report() == 'begun'
    leaf.orders.put(SUCCESS)
    woken.wait()
    while tree.tick_once() is not SUCCESS:
        woken.wait()
    assert leaf.most_at_work == 1


def test_on_halted_can_end_what_the_thread_waits_for() -> None:
    tree, leaf, _ = worker()
    tree.tick_once()
    assert leaf.report() == 'begun'
    leaf.stopped = lambda: leaf.orders.put(SUCCESS)
    tree.halt()
    assert leaf.report() == 'halted'


def test_errors_while_a_thread_is_halted_are_raised_by_the_tree() -> None:
    tree, leaf, woken = worker()
    tree.tick_once()
    assert leaf.report() == 'begun'

    def broken() -> None:
        raise OSError('cannot stop')

    leaf.stopped = broken
    with pytest.raises(NodeExecutionError, match='cannot stop'):
        tree.halt()
    leaf.orders.put(broken)
    woken.wait()
    assert leaf.report() == 'halted'
    with pytest.raises(NodeExecutionError, match=r'\[w\].*cannot stop'):
        tree.advance_unfinished()
    # An error that was there before the halt, and that no tick has seen.
    leaf.stopped = lambda: None
    assert tree.tick_once() is RUNNING
    leaf.orders.put(broken)
    woken.wait()
    with pytest.raises(NodeExecutionError, match='cannot stop'):
        tree.halt()


class SignallingClock(ManualClock):
    """Tells when somebody waits for a time."""

    def __init__(self) -> None:
        super().__init__()
        self.asked = threading.Event()

    def call_at(self, when: float, callback: Callable[[], None]) -> Timer:
        timer = super().call_at(when, callback)
        self.asked.set()
        return timer


class Sleeper(ThreadedAction):
    """Sleeps for ten seconds."""

    def run(self) -> NodeStatus:
        try:
            self.sleep(10.0)
        except Halted:
            self.services.append('halted')
            raise
        return SUCCESS


def test_sleep_goes_by_the_clock_of_the_tree() -> None:
    clock = SignallingClock()
    tree = make('<Sleeper name="s"/>', Sleeper, clock=clock)
    woken = Woken(tree)
    assert tree.tick_once() is RUNNING
    assert clock.asked.wait(PATIENCE)
    clock.advance(9.9)
    assert tree.tick_once() is RUNNING
    clock.advance(0.1)
    woken.wait()
    assert tree.tick_once() is SUCCESS


def test_a_halt_ends_a_sleep() -> None:
    clock = SignallingClock()
    tree = make('<Sleeper name="s"/>', Sleeper, clock=clock)
    woken = Woken(tree)
    tree.tick_once()
    assert clock.asked.wait(PATIENCE)
    tree.halt()
    woken.wait()
    assert not tree.unfinished
    assert tree.context.services == ['halted']


@settings(max_examples=25, deadline=None)
@given(ops=st.lists(st.sampled_from(['tick', 'tick', 'halt', SUCCESS, FAILURE, 'raise']), max_size=14))
def test_any_order_of_ticks_halts_and_results_keeps_to_one_call_at_a_time(ops: list[Any]) -> None:
    tree, leaf, woken = worker()
    # The call that is under way: None, or whether it was halted; and the result that the node has to give next.
    under_way: bool | None = None
    due: Any = None

    def raise_error() -> None:
        raise OSError('broken')

    for op in ops:
        if op == 'tick':
            try:
                result: Any = tree.tick_once()
            except NodeExecutionError:
                result = 'raise'
            assert result == (RUNNING if due is None else due)
            if due is None and under_way is None:
                assert leaf.report() == 'begun'
                under_way = False
            due = None
            if result == 'raise':
                tree.halt()
        elif op == 'halt':
            try:
                tree.halt()
            except NodeExecutionError:
                assert due == 'raise'
            if under_way is not None:
                under_way = True
            due = None
        elif under_way is not None:
            leaf.orders.put(raise_error if op == 'raise' else op)
            woken.wait()
            assert leaf.report() in ('ended', 'halted')
            if not under_way:
                due = op
            elif op == 'raise':
                with pytest.raises(NodeExecutionError):
                    tree.advance_unfinished()
            under_way = None
        assert bool(tree.unfinished) == (under_way is True)
    leaf.orders.put(SUCCESS)
    assert leaf.most_at_work <= 1


def test_what_is_for_run_alone_is_refused_outside_and_a_result_that_nobody_has_reset_is_kept() -> None:
    tree = make('<IfThenElse><Worker name="w" out="{x}"/><AlwaysSuccess/></IfThenElse>', Worker)
    leaf = tree.nodes[1]
    assert isinstance(leaf, Worker)
    with pytest.raises(RuntimeError, match=r'^sleep is for run alone$'):
        leaf.sleep(1.0)
    leaf.set_output('out', 5)
    assert tree.blackboard.get('x') == 5
    assert not leaf.halt_requested
    woken = Woken(tree)
    assert tree.tick_once() is RUNNING
    leaf.orders.put(FAILURE)
    woken.wait()
    assert [tree.tick_once() for _ in range(2)] == [FAILURE, FAILURE]
    assert [leaf.report() for _ in range(2)] == ['begun', 'ended']
    assert leaf.reports.empty()
