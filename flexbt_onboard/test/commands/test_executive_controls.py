# SPDX-License-Identifier: BSD-3-Clause
"""Pause, locks, breakpoints, repeat, levels of sub-trees and switching, as operators see and do them over the link."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from typing import Any

import pytest

from flexbt_core.state_machine.authoring.machine import OperatableStateMachine
from flexbt_core.state_machine.model.autonomy import Autonomy
from flexbt_core.state_machine.model.event_state import EventState
from flexbt_msgs.msg import ExecutiveCommand, ExecutiveStatus
from flexbt_testing.nodes.executive_bench import ExecutiveBench, behavior_of
from flexbt_testing.waiting import DEADLINE, wait_until

C = ExecutiveCommand


class Step(EventState):
    """Done when it is told so, and counts its entries."""

    done = False

    def __init__(self, entered: list[str]) -> None:
        super().__init__(outcomes=['done'], desired_rate=None)
        self._entered = entered

    def on_enter(self, userdata: Any) -> None:
        self._entered.append(self.path)

    def execute(self, userdata: Any) -> str | None:
        return 'done' if self.done else None


class ControlBench(ExecutiveBench):
    """Behaviors of a nested step and a last one; the second has another last one, the third lacks the first."""

    def __init__(self) -> None:
        self.entered: list[str] = []
        self.inner: Step = Step(self.entered)
        super().__init__(
            behavior_of(lambda: self._machine('Last')),
            behavior_of(lambda: self._machine('Other'), 'Changed'),
            behavior_of(lambda: self._machine('Last', 'Else'), 'Unlike'),
        )

    def _machine(self, last: str, first: str = 'A') -> OperatableStateMachine:
        self.inner = Step(self.entered)
        inner = OperatableStateMachine(outcomes=['done'])
        with inner:
            OperatableStateMachine.add(first, self.inner, {'done': 'done'}, autonomy={'done': Autonomy.High})
        machine = OperatableStateMachine(outcomes=['finished'])
        with machine:
            OperatableStateMachine.add('M', inner, {'done': last})
            OperatableStateMachine.add(last, Step(self.entered), {'done': 'finished'})
        return machine

    def finish_inner(self, state: Step) -> None:
        """Let the inner state want to be left."""
        state.done = True
        state.wake()


@pytest.fixture
def bench() -> Iterator[ControlBench]:
    bench = ControlBench()
    yield bench
    bench.close()


def test_a_paused_run_stands_still_until_it_goes_on(bench: ControlBench) -> None:
    bench.start()
    bench.wait_active('/M/A')
    bench.applied(C.PAUSE)
    bench.wait_for(lambda s: s.state == ExecutiveStatus.PAUSED and s.active_states[0].paused, 'paused')
    assert 'paused already' in bench.refused(C.PAUSE)
    bench.finish_inner(bench.inner)
    bench.wait_for_next_status()
    assert [state.path for state in bench.status.active_states] == ['/M/A']
    bench.applied(C.RESUME)
    bench.wait_active('/Last')
    assert bench.status.state == ExecutiveStatus.RUNNING
    assert 'not paused' in bench.refused(C.RESUME)
    bench.applied(C.PAUSE)
    bench.applied(C.STOP)
    assert bench.wait_idle() == 'preempted'


def test_locks_and_breakpoints_are_shown_and_hold(bench: ControlBench) -> None:
    bench.start()
    bench.wait_active('/M/A')
    for kind in (C.LOCK, C.UNLOCK, C.BREAKPOINT, C.CLEAR_BREAKPOINT, C.REPEAT):
        assert 'path' in bench.refused(kind)
        assert 'nowhere' in bench.refused(kind, path='/nowhere')
    bench.applied(C.BREAKPOINT, path='/M/A')
    bench.finish_inner(bench.inner)
    (decision,) = bench.wait_for(lambda status: status.decisions, 'breakpoint')
    assert (decision.path, decision.outcome) == ('/M/A', 'done')
    bench.applied(C.LOCK, path='/M')
    assert (list(bench.status.locked), list(bench.status.breakpoints)) == (['/M'], ['/M/A'])
    bench.applied(C.CLEAR_BREAKPOINT, path='/M/A')
    bench.wait_for(lambda s: not s.decisions and not s.breakpoints, 'breakpoint cleared')
    assert '/Last' not in bench.entered
    bench.applied(C.UNLOCK, path='/M')
    bench.wait_active('/Last')
    assert list(bench.status.locked) == []


def activities(bench: ControlBench) -> list[str]:
    """Return what the only active state is shown to do."""
    (state,) = bench.status.active_states
    return list(state.activity)


def test_what_a_lock_holds_back_is_shown_with_its_lock(bench: ControlBench) -> None:
    bench.start(autonomy=1)
    bench.wait_active('/M/A')
    bench.applied(C.LOCK, path='/M/A')
    assert activities(bench) == []
    bench.finish_inner(bench.inner)  # by itself
    bench.wait_for(lambda _: activities(bench) == ["'done' waits for the unlock of /M/A"], 'held back')
    bench.applied(C.LOCK, path='/M')
    assert activities(bench) == ["'done' waits for the unlock of /M, /M/A"]
    bench.applied(C.UNLOCK, path='/M/A')
    assert activities(bench) == ["'done' waits for the unlock of /M"]
    bench.applied(C.UNLOCK, path='/M')
    bench.wait_for(lambda status: status.decisions and activities(bench) == [], 'asked for instead')
    bench.applied(C.LOCK, path='/M/A')
    bench.wait_for(lambda status: not status.decisions and len(activities(bench)) == 1, 'held back again')
    bench.applied(C.FORCE, path='/M', outcome='done')
    assert activities(bench)[0] == "/M: 'done' waits for the unlock of /M/A"
    bench.applied(C.UNLOCK, path='/M/A')
    bench.wait_active('/Last')
    bench.applied(C.LOCK, path='/Last')
    bench.applied(C.FORCE, path='/Last', outcome='done')
    assert activities(bench) == ["'done' waits for the unlock of /Last"]  # with the answer, not later
    bench.applied(C.REPEAT, path='/Last')
    bench.wait_for(lambda _: activities(bench) == [], 'repeated, and nothing wanted')
    bench.applied(C.STOP)
    assert bench.wait_idle() == 'preempted'


def test_a_state_is_repeated_and_a_sub_tree_has_its_own_level(bench: ControlBench) -> None:
    bench.start(autonomy=3)
    bench.wait_active('/M/A')
    entered = bench.status.active_states[0].entered
    bench.applied(C.REPEAT, path='/M/A')
    bench.wait_for(lambda s: s.active_states and s.active_states[0].entered != entered, 'entered again')
    assert bench.entered == ['/M/A', '/M/A']
    bench.applied(C.AUTONOMY, autonomy=1, path='/M')
    levels = [(entry.path, entry.level) for entry in bench.status.autonomy_levels]
    assert (bench.status.autonomy, levels) == (3, [('/M', 1)])
    assert bench.logged('level of autonomy is Low now').path == '/M'
    bench.finish_inner(bench.inner)
    bench.wait_for(lambda status: status.decisions, 'decision')
    bench.applied(C.AUTONOMY, autonomy=3)
    bench.wait_active('/Last')
    assert list(bench.status.autonomy_levels) == []
    bench.logged('level of autonomy is Full now, instead of those of /M (Low)')
    bench.applied(C.AUTONOMY, autonomy=2)
    bench.applied(C.STOP)
    bench.wait_idle()
    assert bench.status.autonomy == 2


def test_a_run_goes_on_with_another_behavior_that_has_the_active_state(bench: ControlBench) -> None:
    run_id = bench.start()
    bench.wait_active('/M/A')
    state = bench.inner
    reason = bench.refused(C.SWITCH, behavior='Unlike')
    assert '/M/A' in reason
    assert 'Nothing' in bench.refused(C.SWITCH, behavior='Nothing')
    assert bench.status.behavior == 'Test'
    bench.applied(C.SWITCH, behavior='Changed')
    assert (bench.status.behavior, bench.run_id) == ('Changed', run_id)
    assert '/Other' in [one.path for one in bench.structures[-1].states]
    assert bench.entered == ['/M/A']  # it was not left
    bench.finish_inner(state)
    bench.wait_active('/Other')
    bench.applied(C.FORCE, path='/Other', outcome='done')
    assert bench.wait_idle() == 'finished'


def wanting(bench: ControlBench, path: str) -> str:
    """Wait until this transition waits for the operator, and return the decision."""
    bench.wait_for(lambda s: [one.path for one in s.decisions] == [path], f'{path} waits')
    return str(bench.status.decisions[0].id)


@pytest.mark.parametrize(
    ('kind', 'name', 'held'),
    [(C.STEP_INTO, 'into', '/M'), (C.STEP_OVER, 'over', '/M'), (C.STEP_OUT, 'out', '/M')],
)
def test_a_step_lets_one_transition_happen_and_holds_a_later_one(
    bench: ControlBench, kind: int, name: str, held: str
) -> None:
    bench.start()
    bench.wait_active('/M/A')
    bench.applied(C.BREAKPOINT, path='/M/A')
    bench.finish_inner(bench.inner)
    decision = wanting(bench, '/M/A')
    assert 'must name decision_id' in bench.refused(kind)
    bench.applied(kind, decision_id=decision)
    bench.wait_for(lambda s: s.step == f'{name} /M/A', 'the step')
    second = wanting(bench, held)  # which nothing else holds
    assert 'not pending' in bench.refused(kind, decision_id=decision)  # answered already
    bench.applied(C.CONFIRM, decision_id=second)
    bench.wait_active('/Last')
    bench.wait_for(lambda s: not s.step, 'no step')


def test_a_step_over_ends_when_it_is_cleared_and_a_stop_ends_it(bench: ControlBench) -> None:
    bench.start()
    bench.wait_active('/M/A')
    bench.applied(C.BREAKPOINT, path='/M/A')
    bench.finish_inner(bench.inner)
    bench.applied(C.STEP_OVER, decision_id=wanting(bench, '/M/A'))
    wanting(bench, '/M')
    bench.applied(C.CLEAR_BREAKPOINT, path='/M/A')  # the breakpoint
    assert bench.status.step
    bench.applied(C.CLEAR_BREAKPOINT, path='/M/A')  # the step: the transition happens
    bench.wait_active('/Last')
    bench.applied(C.STOP)
    bench.wait_for(lambda s: s.state == ExecutiveStatus.IDLE and not s.step, 'idle')


def test_a_switch_that_returns_when_its_run_was_given_up_changes_nothing_that_is_shown(
    monkeypatch: pytest.MonkeyPatch, bench: ControlBench
) -> None:
    holds, goes_on = threading.Event(), threading.Event()

    def hold(_state: EventState) -> None:
        holds.set()
        goes_on.wait(DEADLINE)

    first = bench.start()
    bench.wait_active('/M/A')
    with monkeypatch.context() as slow:
        slow.setattr(Step, 'on_start', hold)
        switch = bench.send(C.SWITCH, behavior='Changed')
        wait_until(holds.is_set, 'the other machine begins')
    run = bench.executive.runs.run
    assert run is not None
    wait_until(lambda: bench.applied(C.STOP) and bench.status.state == ExecutiveStatus.IDLE, 'the run is given up')
    second = bench.start()
    bench.wait_active('/M/A')
    goes_on.set()
    assert run.join(DEADLINE)
    bench.wait_for_next_status()
    bench.result(switch)  # it is answered
    assert [one.run_id for one in bench.structures] == [first, second]
    assert (bench.run_id, bench.status.behavior) == (second, 'Test')
