# SPDX-License-Identifier: BSD-3-Clause
"""When states are executed: woken by events, at times that they ask for, at a rate; and never otherwise."""

from __future__ import annotations

import math
import threading
from typing import Any

import pytest

from flexbt_core.clock.clock import ManualClock, SteadyClock
from flexbt_core.clock.waiting import WakeEvent
from flexbt_core.state_machine.authoring.checked_definition import define
from flexbt_core.state_machine.engine.run import MachineRun
from flexbt_core.state_machine.model.autonomy import Autonomy
from flexbt_core.state_machine.model.definition import Child
from flexbt_core.state_machine.model.event_state import EventState
from flexbt_core.state_machine.model.userdata import StateError
from flexbt_testing.state_machines.bench import Bench, Do, Scripted, machine, nested
from flexbt_testing.waiting import DEADLINE


def times_into(seen: list[float]) -> Do:
    return lambda state, _: seen.append(state.clock.now())


def test_while_nothing_happens_nothing_runs() -> None:
    state = Scripted()
    bench = Bench(nested(state, 'A/B/C/D'))
    steps = bench.steps
    assert bench.run.next_wake is None
    assert bench.clock.next_timer() is None
    bench.pass_time(1e6)
    assert (bench.steps, state.calls('execute')) == (steps, 1)


def test_transitions_leave_no_timers_behind() -> None:
    """Each would be a wake-up for nothing, some seconds later."""
    states = [Scripted(), Scripted()]
    bench = Bench(machine(Child('A', states[0], {'done': 'B'}), Child('B', states[1], {'done': 'A'})))
    for number in range(20):
        states[number % 2].end('done')
        bench.settle()
        states[number % 2].outcome = None
    assert bench.active == ('/A',)
    assert bench.clock.next_timer() is None
    bench.stop()
    assert bench.clock.next_timer() is None


def test_a_state_that_wants_to_be_woken_at_no_time_has_a_fault_and_the_run_goes_on() -> None:
    state = Scripted('failed', do={'execute': lambda state, _: state.wake_at(math.nan)})
    bench = Bench(machine(Child('A', state, {'failed': 'B'}), Child('B', Scripted(), {'done': 'ended'})))
    assert (bench.active, bench.run.next_wake) == (('/B',), None)
    assert '/A: a state cannot be woken at the time nan' in bench.faults[0][1]


@pytest.mark.parametrize('rate', [0.5, 4.0, 8.0])
def test_a_polling_state_is_executed_at_its_rate(rate: float) -> None:
    seen: list[float] = []
    state = Scripted(do={'execute': times_into(seen)}, rate=rate)
    bench = Bench(nested(state, 'A/B'))
    bench.pass_time(10.0)
    assert seen == [number / rate for number in range(int(10 * rate) + 1)]
    assert bench.steps == len(seen)


def test_the_rate_counts_from_the_last_execution() -> None:
    seen: list[float] = []
    state = Scripted(do={'execute': times_into(seen)}, rate=1.0)
    bench = Bench(nested(state, 'A'))
    bench.pass_time(1.5)
    state.wake()
    bench.settle()
    bench.pass_time(1.5)
    assert seen == [0.0, 1.0, 1.5, 2.5]


@pytest.mark.parametrize('rate', [0.0, -1.0, float('nan')])
def test_a_rate_has_to_be_positive(rate: float) -> None:
    with pytest.raises(StateError, match='desired_rate has to be positive, or None, not'):
        EventState(['done'], desired_rate=rate)


@pytest.mark.parametrize('rate', [0, -1.0, math.nan, 'fast'])
def test_a_state_that_sets_a_rate_that_cannot_be_has_a_fault(rate: Any) -> None:
    state = Scripted('failed', do={'on_enter': lambda state, _: setattr(state, 'desired_rate', rate)})
    bench = Bench(machine(Child('A', state, {'failed': 'ended'})))
    assert bench.outcome == 'ended'
    ((path, text),) = bench.faults
    assert path == '/A' and text.startswith('execute raised')


@pytest.mark.parametrize('callback', ['on_enter', 'execute'])
@pytest.mark.parametrize('rate', [None, 3.0])
def test_a_timeout_is_exactly_at_its_time(callback: str, rate: float | None) -> None:
    """Asked for once: that the state is executed for other reasons in between does not undo it."""
    deadline = 5.7

    def arm(state: Scripted, _: Any) -> None:
        if state.calls(callback) == 1:
            state.wake_at(deadline)

    def execute(state: Scripted, userdata: Any) -> str | None:
        if callback == 'execute':
            arm(state, userdata)
        return 'done' if state.clock.now() >= deadline else None

    state = Scripted(do={'on_enter': arm if callback == 'on_enter' else times_into([]), 'execute': execute}, rate=rate)
    bench = Bench(nested(state, 'A/B'))
    bench.pass_time(2.0)
    state.wake()
    bench.pass_time(20.0)
    assert bench.outcome == 'done'
    assert bench.snapshots[-1].active == ()
    (left,) = [event for event in state.trace if event.startswith('on_exit')]
    assert left == 'on_exit OUTCOME'


def test_of_several_times_each_is_kept_once() -> None:
    seen: list[float] = []

    def arm(state: Scripted, _: Any) -> None:
        for time in (3.0, 1.0, 7.0, 3.0):
            state.wake_at(time)

    state = Scripted(do={'on_enter': arm, 'execute': times_into(seen)})
    bench = Bench(nested(state, 'A'))
    bench.pass_time(100.0)
    assert seen == [0.0, 1.0, 3.0, 7.0]


def test_times_that_were_asked_for_end_with_the_visit() -> None:
    def arm(state: Scripted, _: Any) -> None:
        if state.calls('on_enter') == 1:
            state.wake_at(5.0)

    seen: list[float] = []
    state = Scripted('again', do={'on_enter': arm, 'execute': times_into(seen)})
    bench = Bench(machine(Child('A', state, {'again': 'A'})))
    bench.pass_time(1.0)
    assert bench.force('/A', 'again') is None
    bench.pass_time(10.0)
    assert seen == [0.0, 1.0]


def test_a_state_that_is_blocked_or_left_is_not_due() -> None:
    def arm(state: Scripted, _: Any) -> None:
        state.wake_at(1.0)

    state = Scripted(outcome='done', do={'on_enter': arm}, rate=10.0)
    bench = Bench(nested(state, 'A', {'done': Autonomy.Full}))
    assert bench.decision.outcome == 'done'
    assert bench.run.next_wake is None
    bench.pass_time(10.0)
    assert state.calls('execute') == 1


def test_news_that_come_while_the_state_is_executed_are_not_lost() -> None:
    def execute(state: Scripted, _: Any) -> str | None:
        if state.calls('execute') == 1:
            state.wake()
            return None
        return 'done'

    bench = Bench(nested(Scripted(do={'execute': execute}), 'A/B'))
    assert bench.outcome == 'done'


def test_news_for_a_state_that_is_not_active_are_nothing() -> None:
    states = [Scripted(), Scripted()]
    bench = Bench(machine(Child('A', states[0], {'done': 'B'}), Child('B', states[1], {'done': 'ended'})))
    states[1].wake()
    bench.settle()
    assert states[1].trace == ['on_start']
    states[0].end('done')
    bench.settle()
    assert states[1].trace == ['on_start', 'on_enter', 'execute']


def test_news_from_other_threads_are_never_lost() -> None:
    """A chain of states, each ended by an event from another thread at whatever moment it is waited for."""
    length = 300
    clock, wake_event = SteadyClock(), WakeEvent()
    states = [Scripted() for _ in range(length)]
    labels = [*(f'S{number}' for number in range(length)), 'ended']
    made = machine(*(Child(labels[i], state, {'done': labels[i + 1]}) for i, state in enumerate(states)))
    bench = Bench(made, start=False)
    run = MachineRun(define(made), clock, [bench], wake_event=wake_event)
    entered = [threading.Event() for _ in states]
    for state, event in zip(states, entered, strict=True):
        state.do['on_enter'] = lambda *_, event=event: event.set()

    def tell() -> None:
        for state, event in zip(states, entered, strict=True):
            assert event.wait(DEADLINE)
            state.end('done')

    teller = threading.Thread(target=tell, daemon=True)
    teller.start()
    run.start()
    limit = clock.call_at(clock.now() + 2 * DEADLINE, run.preempt)
    while run.step():
        wake_event.wait(clock, run.next_wake)
    limit.cancel()
    teller.join(DEADLINE)
    clock.close()
    assert run.outcome == 'ended'


def test_time_that_goes_back_wakes_nobody_early() -> None:
    clock = ManualClock(100.0)
    seen: list[float] = []
    state = Scripted(do={'on_enter': lambda state, _: state.wake_at(105.0), 'execute': times_into(seen)})
    run = MachineRun(define(nested(state, 'A')), clock, [Bench(nested(Scripted(), 'A'))])
    run.start()
    for now in (100.0, 50.0, 104.0, 105.0):
        clock.set(now)
        assert run.step()
    assert seen == [100.0, 105.0]
