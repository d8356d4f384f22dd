# SPDX-License-Identifier: BSD-3-Clause
"""A leaf that is a coroutine: ticks, time, futures, errors, and halts that take several ticks."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from concurrent.futures import Future
from typing import Any

import pytest

from flexbt_core.behavior_tree.engine.asynchronous_actions import CoroutineAction
from flexbt_core.behavior_tree.engine.leaf import Halted
from flexbt_core.behavior_tree.engine.tree import Tree
from flexbt_core.behavior_tree.model.errors import NodeExecutionError
from flexbt_core.behavior_tree.model.status import NodeStatus
from flexbt_core.clock.clock import ManualClock
from flexbt_testing.behavior_trees import scripted_nodes as bt_scripted
from flexbt_testing.behavior_trees.random_trees import wheel_case
from flexbt_testing.behavior_trees.steps import NAMES, Woken
from flexbt_testing.behavior_trees.steps import make as make_steps

SUCCESS, FAILURE, RUNNING, SKIPPED = NodeStatus.SUCCESS, NodeStatus.FAILURE, NodeStatus.RUNNING, NodeStatus.SKIPPED


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
    assert tree.nodes[2].status is RUNNING
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
    cases = [case for case in map(wheel_case, range(250)) if 'K' not in case['xml']]
    expected = [bt_scripted.Run(case).trace() for case in cases]
    monkeypatch.setattr(bt_scripted, 'Act', Act)
    assert len(cases) > 40
    for case, trace in zip(cases, expected, strict=True):
        assert bt_scripted.Run(case).trace() == trace, case['xml']


def test_a_result_that_nobody_has_reset_is_kept() -> None:
    async def fails(self: Dance) -> NodeStatus:
        self.note('run')
        return FAILURE

    tree, notes = dance(fails, '<IfThenElse><Dance name="d"/><AlwaysSuccess/></IfThenElse>')
    assert [tree.tick_once() for _ in range(2)] == [FAILURE, FAILURE]
    assert notes == ['run']
