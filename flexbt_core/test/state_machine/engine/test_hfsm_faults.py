# SPDX-License-Identifier: BSD-3-Clause
"""What becomes of a run when the code of a state raises: a defined end that is seen, and no callback twice."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import pytest

from flexbt_core.state_machine.model.autonomy import Autonomy
from flexbt_core.state_machine.model.definition import Child
from flexbt_core.state_machine.model.event_state import ExitReason
from flexbt_testing.state_machines.bench import Bench, Do, Scripted, machine, nested, passing


class Nonsense:
    """Cannot even be compared."""

    __hash__ = None  # type: ignore[assignment]

    def __repr__(self) -> str:
        return 'nonsense'

    def __eq__(self, other: object) -> bool:
        raise ValueError('the truth of it is ambiguous')


def boom(state: Scripted, userdata: Any) -> Any:
    raise ArithmeticError('wheels have no radius')


def bench_of(state: Scripted, depth: int, autonomy: int = Autonomy.Full) -> Bench:
    """Return the state below ``depth`` machines, initial in each of them, and after it a state for each of its
    outcomes."""
    inner = nested(state, '/'.join('ABC'[:depth])) if depth else state
    after = [Child(f'After_{name}', passing(), {'done': name}) for name in state.outcomes]
    ways = {name: f'After_{name}' for name in state.outcomes}
    return Bench(machine(Child('Top', inner, ways), *after, outcomes=state.outcomes), autonomy=autonomy)


DEPTHS = pytest.mark.parametrize('depth', [0, 1, 3])


@DEPTHS
@pytest.mark.parametrize('callback', ['on_enter', 'execute', 'on_exit'])
@pytest.mark.parametrize('outcomes', [('done', 'failed'), ('done',)])
def test_a_state_that_raises_is_left_by_failed_or_ends_the_run(
    callback: str, outcomes: tuple[str, ...], depth: int
) -> None:
    state = Scripted(*outcomes, outcome='done', do={callback: boom})
    bench = bench_of(state, depth)
    path = '/Top' + '/A/B/C'[: 2 * depth]
    assert bench.outcome == ('failed' if 'failed' in outcomes else 'error')
    assert (path in bench.run.message) is (bench.outcome == 'error')
    ((where, text),) = bench.faults
    assert where == path
    assert text.startswith(f'{callback} raised:\nTraceback')
    assert 'wheels have no radius' in text
    reason = ExitReason.OUTCOME if callback == 'on_exit' else ExitReason.FAULT
    expected = {
        'on_enter': ['on_enter'],
        'execute': ['on_enter', 'execute'],
        'on_exit': ['on_enter', 'execute'],
    }[callback]
    assert state.trace == ['on_start', *expected, f'on_exit {reason.name}', 'on_stop']
    visited = [event for event in bench.trace if event.startswith('on_enter /After')]
    assert visited == (['on_enter /After_failed'] if 'failed' in outcomes else [])
    if 'failed' in outcomes:
        assert [outcome for where, outcome, _, reason in bench.transitions if where == path] == ['failed']
        assert bench.transitions[0][3] is ExitReason.FAULT


@DEPTHS
@pytest.mark.parametrize('answer', ['nope', '', 3, ['done'], Nonsense(), True], ids=repr)
def test_an_outcome_that_is_not_declared_is_a_fault(answer: Any, depth: int) -> None:
    state = Scripted('done', 'failed', do={'execute': lambda *_: answer})
    bench = bench_of(state, depth)
    assert bench.outcome == 'failed'
    assert state.trace == ['on_start', 'on_enter', 'execute', 'on_exit FAULT', 'on_stop']
    ((_, text),) = bench.faults
    assert 'none of its outcomes done, failed' in text or 'ambiguous' in text


@pytest.mark.parametrize('rate', [None, 0.1])
def test_a_fault_is_acted_upon_at_once_not_when_the_state_is_due_next(rate: float | None) -> None:
    def execute(state: Scripted, _: Any) -> None:
        if state.calls('execute') > 1:
            raise ArithmeticError

    state = Scripted(do={'execute': execute}, rate=rate)
    bench = bench_of(state, 2)
    assert bench.active == ('/Top/A/B',)
    state.wake()
    bench.settle()
    assert bench.outcome == 'error'
    assert bench.clock.now() == 0.0


def test_what_raises_in_on_start_ends_the_run_before_anything_is_entered() -> None:
    states = [passing(), Scripted(outcome='done', do={'on_start': boom}), passing()]
    labels = [*(f'S{number}' for number in range(3)), 'ended']
    bench = Bench(
        machine(*(Child(labels[i], state, {'done': labels[i + 1]}) for i, state in enumerate(states))),
    )
    assert bench.outcome == 'error'
    assert '/S1 raised in on_start' in bench.run.message
    assert [path for path, _ in bench.faults] == ['/S1']
    assert [state.trace for state in states] == [['on_start', 'on_stop']] * 3


def test_what_raises_in_on_stop_is_shown_and_changes_neither_the_outcome_nor_the_others() -> None:
    states = [Scripted(outcome='done', do={'on_stop': boom}) for _ in range(3)]
    labels = [*(f'S{number}' for number in range(3)), 'ended']
    bench = Bench(machine(*(Child(labels[i], state, {'done': labels[i + 1]}) for i, state in enumerate(states))))
    assert bench.outcome == 'ended'
    assert [path for path, _ in bench.faults] == ['/S0', '/S1', '/S2']
    assert all(state.calls('on_stop') == 1 for state in states)
    assert all(state.path == 'Scripted' for state in states), 'they are free for another run'


def test_nobody_knows_whether_a_state_that_raises_in_settled_is_at_rest() -> None:
    state = Scripted(outcome='done', do={'halting': boom})
    bench = bench_of(state, 1)
    state.wake()
    bench.settle()
    assert bench.active == ('/Top/A',)
    assert [text.partition('\n')[0] for _, text in bench.faults] == ['halting raised:']
    bench.pass_time(3.0)
    assert bench.outcome == 'done'
    assert bench.faults[1:] == [('/Top/A', 'had not halted 3 s after it was left: halting() raised')]


def test_a_state_that_raised_in_settled_is_asked_again_in_its_next_visit() -> None:
    state = Scripted('again', outcome='again', do={'halting': boom})
    bench = Bench(machine(Child('A', state, {'again': 'A'})))
    state.outcome = None
    bench.pass_time(3.0)
    assert (len(bench.faults), state.calls('on_enter')) == (2, 2)
    del state.do['halting']
    assert bench.force('/A', 'again') is None
    assert (len(bench.faults), state.calls('on_enter')) == (2, 3)


@DEPTHS
@pytest.mark.parametrize('outcomes', [('done', 'failed'), ('done',)])
@pytest.mark.parametrize('how', ['stop', 'force it', 'force what is around it'])
def test_a_fault_in_on_exit_is_shown_but_what_others_decided_stands(
    how: str, outcomes: tuple[str, ...], depth: int
) -> None:
    state = Scripted(*outcomes, do={'on_exit': boom})
    bench = bench_of(state, depth)
    if how == 'stop':
        bench.stop()
    else:
        assert bench.force(bench.active[0] if how == 'force it' else '/Top', 'done') is None
    assert bench.outcome == ('preempted' if how == 'stop' else 'done')
    assert [text.partition('\n')[0] for _, text in bench.faults] == ['on_exit raised:']
    assert (state.calls('on_exit'), state.calls('on_stop')) == (1, 1)


def test_a_state_that_cannot_be_entered_nor_left_fails_once() -> None:
    state = Scripted('done', 'failed', do={'on_enter': boom, 'on_exit': boom, 'on_stop': boom})
    bench = bench_of(state, 1)
    assert bench.outcome == 'failed'
    assert [text.partition('\n')[0] for _, text in bench.faults] == [
        f'{callback} raised:' for callback in ('on_enter', 'on_exit', 'on_stop')
    ]


@pytest.mark.parametrize('callback', ['on_enter', 'execute', 'on_exit'])
def test_failing_needs_the_approval_that_its_outcome_requires(callback: str) -> None:
    state = Scripted('done', 'failed', outcome='done', do={callback: boom})
    levels = {'done': Autonomy.Off, 'failed': Autonomy.High}
    bench = Bench(nested(state, 'A/B', levels), autonomy=Autonomy.Low)
    decision = bench.decision
    assert (decision.path, decision.outcome, decision.required) == ('/A/B', 'failed', Autonomy.High)
    assert bench.transitions == []
    state.wake()
    bench.pass_time(100.0)
    assert bench.decision == decision
    calls = list(state.trace)
    assert bench.confirm() is None
    assert bench.outcome == 'failed'
    assert state.calls('on_exit') == 1
    assert [event for event in state.trace[len(calls) :] if 'on_exit' not in event] == ['on_stop']


@pytest.mark.parametrize('callback', ['on_pause', 'on_resume'])
def test_what_was_forced_before_a_state_failed_approves_no_failure(callback: str) -> None:
    state = Scripted('done', 'failed', do={callback: boom})
    bench = Bench(nested(state, 'A/B', {'failed': Autonomy.High}), autonomy=Autonomy.Low)
    bench.lock('/A/B')
    assert bench.force('/A/B', 'done') is None
    bench.pause()
    bench.resume()
    bench.unlock('/A/B')
    assert (bench.outcome, bench.decision.outcome, bench.run.approved()) == (None, 'failed', {})


def test_the_operator_may_overrule_a_state_that_failed_when_it_was_left() -> None:
    state = Scripted('done', 'failed', outcome='done', do={'on_exit': boom})
    bench = Bench(nested(state, 'A', {'failed': Autonomy.Full}))
    assert bench.force('/A', 'done', bench.decision.id) is None
    assert (bench.outcome, state.calls('on_exit')) == ('done', 1)


class Escaping(Bench):
    """As the executive does when something escapes from the machine, it ends the run."""

    def _step(self) -> None:
        try:
            super()._step()
        except SystemExit as error:
            self.run.fail(f'{type(error).__name__} escaped')
            self.wake_event.set()


@pytest.mark.parametrize('callback', ['on_enter', 'execute', 'on_exit', 'on_stop', 'halting'])
def test_what_even_escapes_from_the_engine_leaves_each_callback_called_once(callback: str) -> None:
    def leave(state: Scripted, _: Any) -> None:
        raise SystemExit

    first, second = passing(), Scripted('done', 'failed', outcome='done', do={callback: once(leave)})
    bench = Escaping(
        machine(Child('One', first, {'done': 'Two'}), Child('Two', second, {'done': 'ended', 'failed': 'ended'}))
    )
    bench.settle()
    assert bench.outcome == ('ended' if callback == 'on_stop' else 'error')
    for state in (first, second):
        assert [state.calls(name) for name in ('on_start', 'on_enter', 'on_exit', 'on_stop')] == [1, 1, 1, 1]


def test_what_escapes_from_on_start_ends_the_run_in_order() -> None:
    def leave(state: Scripted, _: Any) -> None:
        raise SystemExit

    states = [Scripted(do={'on_start': leave}), Scripted()]
    bench = Escaping(
        machine(Child('One', states[0], {'done': 'Two'}), Child('Two', states[1], {'done': 'ended'})), start=False
    )
    with pytest.raises(SystemExit):
        bench.run.start()
    bench.run.fail('SystemExit escaped')
    assert not bench.run.step()
    assert (bench.outcome, bench.run.message) == ('error', 'SystemExit escaped')
    assert [state.trace for state in states] == [['on_start', 'on_stop'], ['on_stop']]


def test_nothing_is_entered_any_more_when_a_state_has_ended_the_run() -> None:
    """The children of a concurrency container are entered one after the other."""
    first, second = Scripted(do={'on_enter': boom}), Scripted()
    both = machine(Child('A', first), Child('B', second), conditions=[('ended', [('A', 'done'), ('B', 'done')])])
    bench = Bench(machine(Child('Both', both, {'ended': 'ended'})))
    assert (bench.outcome, first.trace[-2:]) == ('error', ['on_exit FAULT', 'on_stop'])
    assert second.trace == ['on_start', 'on_stop']


@pytest.mark.parametrize('is_blocked', [False, True])
def test_nothing_is_executed_any_more_when_a_state_has_ended_the_run(is_blocked: bool) -> None:
    class Continuing(Scripted):
        runs_while_blocked = True

    first, second = Continuing(outcome='done' if is_blocked else None), Scripted()
    ended = [('ended', [('A', 'done'), ('B', 'done')])]
    bench = Bench(machine(Child('A', first, {}, {'done': Autonomy.Full}), Child('B', second), conditions=ended))
    assert bool(bench.run.decisions) is is_blocked
    first.do['execute'] = boom
    first.wake()
    second.wake()
    bench.settle()
    assert (bench.outcome, second.calls('execute')) == ('error', 1)


def once(do: Do) -> Do:
    """Only the first time."""
    times: Iterator[Do] = iter([do])
    return lambda state, userdata: next(times, lambda *_: None)(state, userdata)
