# SPDX-License-Identifier: BSD-3-Clause
"""Time-outs and further attempts around any state."""

from __future__ import annotations

from typing import Any

import pytest

from flexbt_core.state_machine.authoring.checked_definition import define
from flexbt_core.state_machine.authoring.wrappers import with_retry, with_timeout
from flexbt_core.state_machine.model.autonomy import Autonomy
from flexbt_core.state_machine.model.definition import Child
from flexbt_core.state_machine.model.event_state import EventState
from flexbt_core.state_machine.model.userdata import MachineError, StateError
from flexbt_testing.state_machines.bench import Bench, Scripted, machine


def bench_of(state: EventState, **options: Any) -> Bench:
    """Return the machine hands out all outcomes."""
    ways = {outcome: outcome for outcome in state.outcomes}
    return Bench(machine(Child('A', state, ways), outcomes=state.outcomes, io_keys=['x']), userdata={'x': 1}, **options)


def failing(times: int, then: str | None = 'done') -> Scripted:
    """Return a state that fails so many times."""

    def enter(state: Scripted, _: Any) -> None:
        state.outcome = 'failed' if state.calls('on_enter') <= times else then

    return Scripted('done', 'failed', do={'on_enter': enter}, io_keys=['x'])


def test_a_state_that_takes_too_long_is_left_by_another_outcome() -> None:
    state = Scripted(rate=10.0)
    bench = bench_of(with_timeout(state, 1.0))
    bench.pass_time(0.99)
    assert bench.active == ('/A',)
    bench.pass_time(0.02)
    assert (bench.outcome, state.trace[-2:]) == ('timeout', ['on_exit TIMED_OUT', 'on_stop'])


def test_a_state_that_is_quicker_knows_nothing_of_it() -> None:
    state = Scripted(input_keys=['x'], do={'execute': lambda _, userdata: seen.append(userdata.x)})
    seen: list[int] = []
    bench = bench_of(with_timeout(state, 1.0, 'late'))
    state.outcome = 'done'
    state.wake()
    bench.settle()
    assert (bench.outcome, seen) == ('done', [1, 1])
    assert state.trace[-2:] == ['on_exit OUTCOME', 'on_stop']
    bench.pass_time(10.0)
    assert bench.transitions[0][1] == 'done'


def test_a_result_that_comes_with_the_end_of_the_time_counts() -> None:
    state = Scripted()
    bench = bench_of(with_timeout(state, 1.0))
    state.outcome = 'done'
    bench.pass_time(1.0)
    assert bench.outcome == 'done'


def test_the_time_stands_still_while_the_state_is_paused_and_begins_again_with_each_visit() -> None:
    bench = bench_of(with_timeout(Scripted(), 1.0))
    bench.pass_time(0.9)
    bench.pause()
    bench.pass_time(10.0)
    bench.resume()
    bench.pass_time(0.05)
    assert bench.repeat('/A') is None
    bench.pass_time(0.9)
    assert bench.active == ('/A',)
    bench.pass_time(0.2)
    assert bench.outcome == 'timeout'


def test_a_time_out_needs_the_approval_that_its_outcome_requires() -> None:
    state = with_timeout(Scripted(), 1.0)
    made = machine(Child('A', state, {'done': 'ended', 'timeout': 'ended'}, {'timeout': Autonomy.Full}))
    bench = Bench(made)
    bench.pass_time(2.0)
    assert (bench.decision.outcome, bench.decision.outcomes) == ('timeout', ('done', 'timeout'))
    assert bench.confirm() is None
    assert bench.outcome == 'ended'


def test_a_state_that_fails_is_tried_again() -> None:
    state = failing(2)
    bench = bench_of(with_retry(state, 3))
    assert bench.outcome == 'done'
    assert state.trace == [
        'on_start',
        *['on_enter', 'execute', 'on_exit REPEATED'] * 2,
        *['on_enter', 'execute', 'on_exit OUTCOME'],
        'on_stop',
    ]
    assert [text for _, _, text in bench.lines] == [
        "left by 'failed'; attempt 2 of 3",
        "left by 'failed'; attempt 3 of 3",
    ]


def test_the_last_attempt_counts() -> None:
    state = failing(9)
    bench = bench_of(with_retry(state, 3))
    assert (bench.outcome, state.calls('on_enter'), state.calls('on_exit')) == ('failed', 3, 3)


def test_the_next_attempt_waits_for_rest_and_for_its_time() -> None:
    state = failing(1)
    busy = ['braking']
    state.do['halting'] = lambda *_: busy[0] if busy and state.calls('on_exit') == 1 else None
    bench = bench_of(with_retry(state, 2, delay=0.5))
    bench.pass_time(1.0)
    assert state.calls('on_enter') == 1
    busy.clear()
    state.wake()
    bench.settle()
    assert bench.outcome == 'done'
    state = failing(1)
    bench = bench_of(with_retry(state, 2, delay=0.5))
    bench.pass_time(0.4)
    assert state.calls('on_enter') == 1
    bench.pass_time(0.2)
    assert bench.outcome == 'done'


def test_a_state_that_does_not_come_to_rest_is_not_tried_again() -> None:
    state = failing(1)
    state.do['halting'] = lambda *_: 'braking'
    bench = bench_of(with_retry(state, 2))
    bench.pass_time(20.0)
    assert (bench.outcome, state.calls('on_enter'), state.calls('on_exit')) == ('failed', 1, 1)
    assert bench.lines[0][2] == 'is not tried again, since it had not halted after 3 s: braking'


@pytest.mark.parametrize('how', ['stop', 'pause'])
def test_between_two_attempts_nothing_is_called(how: str) -> None:
    state = failing(1)
    bench = bench_of(with_retry(state, 2, delay=1.0))
    if how == 'stop':
        bench.stop()
    else:
        bench.pause()
        bench.pass_time(5.0)
        bench.resume()
        assert state.trace[-1] == 'on_exit REPEATED'
        bench.pass_time(1.0)
        assert bench.outcome == 'done'
    assert state.calls('on_enter') == state.calls('on_exit')
    assert state.calls('on_pause') == state.calls('on_resume') == 0


def test_wrappers_go_around_each_other() -> None:
    state = failing(0, None)
    bench = bench_of(with_retry(with_timeout(state, 1.0), 3, on=['timeout', 'failed']))
    bench.pass_time(2.5)
    assert (bench.active, state.calls('on_enter')) == (('/A',), 3)
    bench.pass_time(1.0)
    assert bench.outcome == 'timeout'
    assert [event for event in state.trace if 'on_exit' in event] == ['on_exit TIMED_OUT'] * 3
    state = failing(99)
    bench = bench_of(with_timeout(with_retry(state, 100, delay=0.3), 1.0, 'late'))
    bench.pass_time(1.0)
    assert (bench.outcome, state.calls('on_enter'), state.calls('on_exit')) == ('late', 4, 4)


def test_a_wrapped_state_asks_and_fails_as_any() -> None:
    asking = Scripted('left', 'right', do={'execute': lambda state, _: state.ask('Where?')})
    bench = bench_of(with_retry(with_timeout(asking, 1.0), 2, on=['left']), autonomy=Autonomy.Off)
    bench.pass_time(5.0)
    assert (bench.decision.prompt, bench.decision.outcome) == ('Where?', '')

    def boom(*_: Any) -> Any:
        raise ArithmeticError

    for callback in ('on_enter', 'execute', 'on_exit'):
        state = Scripted('done', 'failed', outcome='done', do={callback: boom})
        bench = bench_of(with_retry(state, 2))
        assert (bench.outcome, state.calls('on_enter'), state.calls('on_exit')) == ('failed', 1, 1)
    wrong = bench_of(with_timeout(Scripted('done', 'failed', do={'execute': lambda *_: 'timeout'}), 1.0))
    assert wrong.outcome == 'failed', 'the outcome is not one of the state itself'


def test_a_state_that_changes_its_rate_is_executed_at_it_in_its_wrappers_too() -> None:
    state = Scripted(rate=1.0, do={'on_enter': lambda state, _: setattr(state, 'desired_rate', 8.0)})
    wrapped = with_retry(with_timeout(state, 60.0), 2, ['done'])
    bench = Bench(machine(Child('S', wrapped, {'done': 'ended', 'timeout': 'ended'})))
    bench.pass_time(2.0)
    assert state.calls('execute') == 17


def test_a_wrapper_looks_like_the_state() -> None:
    state = Scripted('done', 'failed', input_keys=['a'], output_keys=['b'], rate=5.0)
    both = with_timeout(with_retry(state, 3), 2.5)
    assert (both.outcomes, both.input_keys, both.output_keys) == (('done', 'failed', 'timeout'), ('a',), ('b',))
    assert (both.desired_rate, both.unwrapped) == (5.0, state)
    made = machine(Child('A', both, dict.fromkeys(both.outcomes, 'ended')), input_keys=['a'])
    assert define(made).structure()[1].type_name == 'Scripted, up to 3 times, at most 2.5 s'


def test_what_cannot_be_wrapped_is_refused() -> None:
    with pytest.raises(StateError, match='a time-out has to be positive, not 0'):
        with_timeout(Scripted(), 0)
    with pytest.raises(StateError, match="cannot be tried again: 'failed' is none of its outcomes"):
        with_retry(Scripted(), 2)
    with pytest.raises(StateError, match='0 attempts'):
        with_retry(Scripted('failed'), 0)
    inner: Any = machine(Child('A', Scripted(), {'done': 'ended'}))
    with pytest.raises(StateError, match='only a state can have a time-out or further attempts'):
        with_timeout(inner, 1.0)
    with pytest.raises(StateError, match='only a state can have a time-out or further attempts'):
        with_retry(inner, 2)
    state = Scripted()
    made = machine(
        Child('A', state, {'done': 'B'}), Child('B', with_timeout(state, 1.0), {'done': 'A', 'timeout': 'ended'})
    )
    with pytest.raises(MachineError, match='/B: the same state object is also /A'):
        define(made)
