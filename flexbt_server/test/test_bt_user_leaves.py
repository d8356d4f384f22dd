# SPDX-License-Identifier: BSD-3-Clause
"""Leaves of users whose work goes on between the ticks, in a thread or as a coroutine; and nodes made of functions."""

from __future__ import annotations

import queue
import threading
import time
from collections.abc import Callable, Iterator
from concurrent.futures import Future
from typing import Any

import bt_random_trees
import bt_scripted
import pytest
from bt_steps import NAMES, step
from bt_steps import make as make_steps
from hypothesis import given, settings
from hypothesis import strategies as st

from flexbt_common.clock import ManualClock, Timer
from flexbt_server.behavior_tree import (
    Condition,
    CoroutineAction,
    Halted,
    NodeExecutionError,
    NodeStatus,
    SimpleAction,
    SimpleDecorator,
    ThreadedAction,
    Tree,
    TreeNode,
    input_port,
    output_port,
    simple_action,
    simple_condition,
    simple_decorator,
)
from flexbt_server.behavior_tree.port_types import INT

SUCCESS, FAILURE, RUNNING, SKIPPED = NodeStatus.SUCCESS, NodeStatus.FAILURE, NodeStatus.RUNNING, NodeStatus.SKIPPED
PATIENCE = 10.0
"""Seconds (wall) after which a thread that should have ended has not."""


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


class Woken:
    """Waits for the wake-ups of a tree."""

    def __init__(self, tree: Tree) -> None:
        self._event = threading.Event()
        tree.context.on_wake = self._event.set

    def wait(self) -> None:
        assert self._event.wait(PATIENCE), 'the tree was not woken'
        self._event.clear()


# -- a leaf run in a thread --------------------------------------------------------------------------------------------


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
    with pytest.raises(NodeExecutionError, match=r'\[w\]'):
        tree.tick_once()
    tree.halt()


def test_a_halt_does_not_wait_for_the_thread_but_the_tree_says_that_it_is_not_at_rest() -> None:
    tree, leaf, woken = worker()
    tree.tick_once()
    assert leaf.report() == 'begun'
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


# -- a coroutine -------------------------------------------------------------------------------------------------------


class Dance(CoroutineAction):
    """Goes through the steps that the test has put into ``steps``, and notes what it does."""

    steps: Callable[[Dance], Any]

    async def run(self) -> NodeStatus:
        result: NodeStatus = await type(self).steps(self)
        return result

    def note(self, what: str) -> None:
        self.services.append(what)


def dance(
    steps: Callable[[Any], Any], body: str = '<Dance name="d"/>', clock: ManualClock | None = None
) -> tuple[Tree, list[str]]:
    class Own(Dance):
        pass

    Own.__name__ = 'Dance'
    Own.steps = steps
    return make_steps(body, clock, extra=(Own,))


def test_a_coroutine_is_advanced_by_ticks() -> None:
    async def steps(self: Dance) -> NodeStatus:
        for number in range(3):
            self.note(str(number))
            await self.next_tick()
        return self.fail('enough') if len(self.services) > 3 else SUCCESS

    tree, notes = dance(steps)
    assert [NAMES[tree.tick_once()] for _ in range(4)] == ['R', 'R', 'R', 'S']
    assert notes == ['0', '1', '2']
    assert [NAMES[tree.tick_once()] for _ in range(4)] == ['R', 'R', 'R', 'F']
    assert tree.failure is not None
    assert tree.failure.reason == 'enough'


def test_a_coroutine_may_be_done_at_once_or_be_skipped() -> None:
    async def done(self: Dance) -> NodeStatus:
        return SUCCESS

    async def skipped(self: Dance) -> NodeStatus:
        await self.next_tick()
        return SKIPPED

    assert dance(done)[0].tick_once() is SUCCESS
    tree, _ = dance(skipped)
    assert [NAMES[tree.tick_once()] for _ in range(4)] == ['R', 'K', 'R', 'K']


def test_a_sleep_asks_for_its_wake_up_and_is_not_shortened_by_other_ticks() -> None:
    clock = ManualClock()

    async def steps(self: Dance) -> NodeStatus:
        await self.sleep(2.0)
        await self.sleep(0.0)
        await self.sleep(1.0)
        return SUCCESS

    tree, _ = dance(steps, clock=clock)
    assert tree.tick_once() is RUNNING
    assert tree.next_wake == 2.0
    clock.set(1.5)
    assert tree.tick_once() is RUNNING
    assert tree.next_wake == 2.0
    clock.set(2.0)
    assert tree.tick_once() is RUNNING
    assert tree.next_wake == 3.0
    clock.set(3.5)
    assert tree.tick_once() is SUCCESS
    assert tree.next_wake is None


def test_a_future_wakes_the_tree_and_gives_its_result_or_its_exception() -> None:
    futures: list[Future[int]] = []

    async def steps(self: Dance) -> NodeStatus:
        future: Future[int] = Future()
        futures.append(future)
        try:
            return SUCCESS if await self.result_of(future) == 7 else FAILURE
        except OSError as error:
            return self.fail(str(error))

    tree, _ = dance(steps)
    woken = Woken(tree)
    for number in (7, 8):
        assert [tree.tick_once() for _ in range(2)] == [RUNNING, RUNNING]
        threading.Thread(target=futures[-1].set_result, args=(number,)).start()
        woken.wait()
        tree.take_wake()
        assert tree.tick_once() is (SUCCESS if number == 7 else FAILURE)
    tree.tick_once()
    futures[-1].set_exception(OSError('broken line'))
    assert tree.tick_once() is FAILURE
    assert tree.failure is not None
    assert tree.failure.reason == 'broken line'


def test_until_asks_at_each_tick() -> None:
    async def steps(self: Dance) -> NodeStatus:
        await self.until(lambda: 'x' in self.blackboard)
        return SUCCESS

    tree, _ = dance(steps)
    assert [tree.tick_once() for _ in range(2)] == [RUNNING, RUNNING]
    tree.blackboard.set('x', 1)
    assert tree.tick_once() is SUCCESS


def test_errors_of_a_coroutine_name_the_node_and_the_next_run_begins_anew() -> None:
    async def steps(self: Dance) -> NodeStatus:
        await self.sleep(1.0)
        raise OSError('broken')

    clock = ManualClock()
    tree, _ = dance(steps, clock=clock)
    for _ in range(2):
        assert tree.tick_once() is RUNNING
        clock.advance(1.0)
        with pytest.raises(NodeExecutionError, match=r'\[d\] \(Dance\): OSError: broken'):
            tree.tick_once()
        assert tree.next_wake is None
    tree.halt()
    assert not tree.unfinished


@pytest.mark.parametrize('nonsense', [None, RUNNING, 'SUCCESS'])
def test_nonsense_from_a_coroutine_is_an_error(nonsense: Any) -> None:
    async def steps(self: Dance) -> Any:
        return nonsense

    with pytest.raises(NodeExecutionError, match=r'\[d\]'):
        dance(steps)[0].tick_once()


def test_what_ticks_cannot_advance_is_refused_where_it_is_awaited() -> None:
    class Foreign:
        def __await__(self) -> Iterator[Any]:
            yield 'a future of another world'

    async def steps(self: Dance) -> NodeStatus:
        try:
            await Foreign()  # type: ignore[misc]
        except TypeError as error:
            return self.fail(str(error))
        return SUCCESS

    tree, _ = dance(steps)
    assert tree.tick_once() is FAILURE
    assert tree.failure is not None
    assert "ticks cannot advance 'a future of another world'" in tree.failure.reason


def test_halted_that_nobody_has_asked_for_is_an_error() -> None:
    async def steps(self: Dance) -> NodeStatus:
        raise Halted

    with pytest.raises(NodeExecutionError):
        dance(steps)[0].tick_once()


async def cleans_up(self: Dance) -> NodeStatus:
    try:
        while True:
            await self.next_tick()
    finally:
        self.note('stopping')
        await self.sleep(2.0)
        await self.next_tick()
        self.note('stopped')


def test_halting_may_take_several_ticks() -> None:
    clock = ManualClock()
    tree, notes = dance(cleans_up, '<ReactiveFallback><Step name="FSFS_0"/><Dance name="d"/></ReactiveFallback>', clock)
    assert tree.tick_once() is RUNNING
    # The tree goes on meanwhile; its ticks advance what is not finished.
    assert tree.tick_once() is SUCCESS
    assert notes == ['0F', '0S', 'stopping']
    assert list(tree.unfinished) == ['[d] is coming to its end']
    notes.clear()
    # Begun again, the node waits for its end.
    assert tree.tick_once() is RUNNING
    clock.advance(2.0)
    assert tree.take_wake()
    assert tree.tick_once() is SUCCESS
    assert notes == ['0F', '0S']
    tree.advance_unfinished()
    assert notes == ['0F', '0S', 'stopped']
    assert not tree.unfinished


def test_a_host_advances_what_is_unfinished_after_the_last_tick() -> None:
    clock = ManualClock()
    tree, notes = dance(cleans_up, clock=clock)
    woken = Woken(tree)
    tree.tick_once()
    tree.halt()
    tree.halt()
    assert notes == ['stopping']
    tree.advance_unfinished()
    clock.advance(2.0)
    woken.wait()
    assert tree.unfinished
    tree.advance_unfinished()
    tree.advance_unfinished()
    assert not tree.unfinished
    assert notes == ['stopping', 'stopped']


def test_a_coroutine_that_was_halted_may_end_at_once_whatever_it_does() -> None:
    async def lets_it_pass(self: Dance) -> NodeStatus:
        await self.next_tick()
        return SUCCESS

    async def returns(self: Dance) -> NodeStatus:
        try:
            await self.next_tick()
        except Halted:
            self.note('caught')
        return SUCCESS

    for steps, noted in ((lets_it_pass, []), (returns, ['caught'])):
        tree, notes = dance(steps)
        tree.tick_once()
        tree.halt()
        assert (tree.unfinished, notes) == ((), noted)
        assert tree.tick_once() is RUNNING


def test_errors_of_a_coroutine_that_was_halted_are_raised_by_the_tree() -> None:
    async def at_once(self: Dance) -> NodeStatus:
        try:
            await self.next_tick()
        finally:
            raise OSError('broken')

    async def later(self: Dance) -> NodeStatus:
        try:
            await self.next_tick()
        finally:
            await self.next_tick()
            raise OSError('broken')

    tree, _ = dance(at_once)
    tree.tick_once()
    with pytest.raises(NodeExecutionError, match=r'\[d\].*broken'):
        tree.halt()
    assert not tree.unfinished
    tree, _ = dance(later)
    tree.tick_once()
    tree.halt()
    with pytest.raises(NodeExecutionError, match=r'\[d\].*broken'):
        tree.advance_unfinished()
    assert not tree.unfinished


def test_coroutines_give_the_trace_of_actions_written_as_state_machines(monkeypatch: pytest.MonkeyPatch) -> None:
    class Act(CoroutineAction):
        script: bt_scripted.Script

        async def run(self) -> NodeStatus:
            status = self.script.call('start')
            try:
                while status is RUNNING:
                    await self.next_tick()
                    status = self.script.call('run')
            except Halted:
                self.script._events.append(['halt', self.path])
                raise
            return status

    # A stateful action that is skipped while it is RUNNING is not over; a coroutine has returned.
    cases = [case for case in map(bt_random_trees.make_case, range(250)) if 'K' not in case['xml']]
    expected = [bt_scripted.Run(case).trace() for case in cases]
    monkeypatch.setattr(bt_scripted, 'Act', Act)
    assert len(cases) > 40
    for case, trace in zip(cases, expected, strict=True):
        assert bt_scripted.Run(case).trace() == trace, case['xml']


# -- nodes made of functions -------------------------------------------------------------------------------------------


def test_an_action_a_condition_and_a_decorator_are_a_function_each() -> None:
    def double(node: SimpleAction) -> NodeStatus:
        """Writes twice the input."""
        node.set_output('out', 2 * node.get_input('in'))
        return SUCCESS

    def is_ten(node: Condition) -> bool:
        return bool(node.get_input('in') == 10)

    def until_ten(status: NodeStatus, node: SimpleDecorator) -> NodeStatus:
        return RUNNING if status is FAILURE else status

    ports = {'in': input_port(INT), 'out': output_port(INT)}
    classes = {
        'Double': simple_action(double, ports),
        'IsTen': simple_condition(is_ten, {'in': ports['in']}),
        'UntilTen': simple_decorator(until_ten),
    }
    assert classes['Double'].__doc__ == 'Writes twice the input.'
    for name, node_class in classes.items():
        node_class.__name__ = name
    body = '<UntilTen><Sequence><Double in="{x}" out="{y}"/><IsTen in="{y}"/></Sequence></UntilTen>'
    tree = make(body, *classes.values())
    tree.blackboard.set('x', 4)
    assert tree.tick_once() is RUNNING
    tree.blackboard.set('x', 5)
    assert tree.tick_once() is SUCCESS


def named(name: str, node_class: type[TreeNode]) -> type[TreeNode]:
    node_class.__name__ = name
    return node_class


@pytest.mark.parametrize('result', [RUNNING, None, True, NodeStatus.IDLE])
def test_a_function_that_gives_nonsense_is_an_error_of_its_node(result: Any) -> None:
    tree = make('<Own name="own"/>', named('Own', simple_action(lambda _: result)))
    with pytest.raises(NodeExecutionError, match=r'\[own\]'):
        tree.tick_once()


def test_a_function_that_raises_is_an_error_of_its_node() -> None:
    def broken(*_: Any) -> NodeStatus:
        raise OSError('broken')

    for node_class, child in (
        (simple_action(broken), ''),
        (simple_condition(broken), ''),
        (simple_decorator(broken), '<AlwaysSuccess/>'),
    ):
        tree = make(f'<Own name="own">{child}</Own>', named('Own', node_class))
        with pytest.raises(NodeExecutionError, match=r'\[own\] \(Own\): OSError: broken'):
            tree.tick_once()


def test_a_decorator_that_ends_while_its_child_runs_halts_it() -> None:
    tree, calls = make_steps(
        f'<Own>{step("R")}</Own>', extra=(named('Own', simple_decorator(lambda status, node: SUCCESS)),)
    )
    assert tree.tick_once() is SUCCESS
    assert calls == ['0R', '0!']
    assert all(node.status is NodeStatus.IDLE for node in tree.nodes)


def test_why_a_decorator_of_a_function_failed() -> None:
    for script, path in (('S', 'own'), ('F', 'F_0')):
        tree = make(
            f'<Own name="own">{step(script)}</Own>', named('Own', simple_decorator(lambda status, node: FAILURE))
        )
        assert tree.tick_once() is FAILURE
        assert tree.failure is not None
        assert tree.failure.path == path
