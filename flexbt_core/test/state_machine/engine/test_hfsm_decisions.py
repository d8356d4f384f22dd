# SPDX-License-Identifier: BSD-3-Clause
"""What the operator decides: confirming, forcing, choosing; and what comes too late."""

from __future__ import annotations

from typing import Any

import pytest

from flexbt_core.state_machine.authoring.machine import OperatableStateMachine
from flexbt_core.state_machine.engine.operator_commands import force, set_autonomy
from flexbt_core.state_machine.model.autonomy import Autonomy, DecisionKind
from flexbt_core.state_machine.model.definition import Child
from flexbt_core.state_machine.model.event_state import ExitReason
from flexbt_testing.state_machines.bench import Bench, Do, Scripted, machine, nested, passing

HIGH = {'done': Autonomy.High, 'failed': Autonomy.Off}


def two(first: Scripted, second: Scripted) -> OperatableStateMachine:
    """Inner with First and Second; each outcome 'failed' leads out, 'done' of First to Second and back."""
    inner = machine(
        Child('First', first, {'done': 'Second', 'failed': 'out'}, HIGH),
        Child('Second', second, {'done': 'First', 'failed': 'out'}, HIGH),
        outcomes=['out', 'never'],
    )
    return machine(
        Child('Inner', inner, {'out': 'After', 'never': 'ended'}, {'out': Autonomy.High}),
        Child('After', Scripted(), {'done': 'ended'}),
    )


def states() -> tuple[Scripted, Scripted]:
    return Scripted('done', 'failed'), Scripted('done', 'failed')


def test_a_blocked_state_is_frozen_until_the_operator_confirms() -> None:
    first, second = states()
    bench = Bench(two(first, second), autonomy=Autonomy.Low)
    first.end('done')
    bench.settle()
    decision = bench.decision
    assert (decision.kind, decision.path, decision.outcome) == (DecisionKind.TRANSITION, '/Inner/First', 'done')
    assert (decision.outcomes, decision.required, decision.prompt) == (('done', 'failed'), Autonomy.High, '')
    before = list(first.trace)
    first.outcome = None
    first.wake()
    bench.pass_time(60.0)
    assert first.trace == before
    assert bench.decision == decision
    assert bench.confirm() is None
    assert bench.active == ('/Inner/Second',)
    assert bench.transitions == [('/Inner/First', 'done', '/Inner/Second', ExitReason.OUTCOME)]


def test_an_approval_holds_for_one_transition() -> None:
    first, second = states()
    first.outcome = second.outcome = 'done'
    bench = Bench(two(first, second), autonomy=Autonomy.Low)
    for path in ('/Inner/First', '/Inner/Second', '/Inner/First'):
        assert bench.decision.path == path
        assert bench.confirm() is None


@pytest.mark.parametrize('autonomy', [Autonomy.Off, Autonomy.Full])
def test_force_by_any_declared_outcome_at_any_level_of_autonomy(autonomy: int) -> None:
    first, second = states()
    bench = Bench(two(first, second), autonomy=autonomy)
    assert bench.force('/Inner/First', 'done') is None
    assert bench.transitions == [('/Inner/First', 'done', '/Inner/Second', ExitReason.FORCED)]
    assert first.trace[-1] == 'on_exit FORCED'
    assert bench.active == ('/Inner/Second',)


def test_forcing_a_machine_leaves_all_that_is_in_it() -> None:
    first, second = states()
    bench = Bench(two(first, second), autonomy=Autonomy.Off)
    assert bench.force('/Inner', 'never') is None
    assert bench.outcome == 'ended'
    assert first.trace[-2:] == ['on_exit PARENT_LEFT', 'on_stop']
    assert bench.transitions == [('/Inner', 'never', '=ended', ExitReason.FORCED)]


def test_forcing_another_outcome_overrides_what_is_asked() -> None:
    first, second = states()
    bench = Bench(two(first, second), autonomy=Autonomy.Low)
    first.end('done')
    bench.settle()
    assert bench.force('/Inner/First', 'failed', bench.decision.id) is None
    assert bench.transitions == [('/Inner/First', 'failed', '=out', ExitReason.FORCED)]
    assert bench.decision.path == '/Inner', 'the end of the machine is a transition of its own'


def test_a_machine_that_has_ended_and_waits_may_be_forced() -> None:
    first, second = states()
    first.outcome = 'failed'
    bench = Bench(two(first, second), autonomy=Autonomy.Low)
    assert (bench.decision.path, bench.decision.outcome, bench.active) == ('/Inner', 'out', ())
    assert bench.force('/Inner/First', 'done') == '/Inner/First is not active (active: none)'
    assert bench.force('/Inner', 'never', bench.decision.id) is None
    assert bench.outcome == 'ended'
    assert first.calls('on_exit') == 1


@pytest.mark.parametrize(
    ('path', 'outcome', 'reason'),
    [
        ('/Inner/First', 'nope', "/Inner/First has no outcome 'nope'; its outcomes are done, failed"),
        ('/Inner', 'done', "/Inner has no outcome 'done'; its outcomes are out, never"),
        ('/Inner/Second', 'done', '/Inner/Second is not active (active: /Inner/First)'),
        ('/After', 'done', '/After is not active (active: /Inner/First)'),
        ('/Nowhere', 'done', "there is no state '/Nowhere'"),
        ('First', 'done', "there is no state 'First'"),
        ('/Inner/First', 'preempted', "/Inner/First has no outcome 'preempted'; its outcomes are done, failed"),
    ],
)
def test_what_cannot_be_forced_is_refused_with_the_reason(path: str, outcome: str, reason: str) -> None:
    first, second = states()
    bench = Bench(two(first, second))
    assert bench.force(path, outcome) == reason
    assert bench.active == ('/Inner/First',)
    assert first.trace == ['on_start', 'on_enter', 'execute']


def test_where_several_states_are_active_all_are_named() -> None:
    children = (Child(label, Scripted()) for label in 'ABC')
    bench = Bench(machine(*children, conditions=[('ended', [('A', 'done'), ('B', 'done')])]))
    assert bench.force('/C', 'done') is None
    assert bench.force('/C', 'done') == '/C is not active (active: /A, /B)'


def test_an_answer_to_an_earlier_decision_is_refused() -> None:
    """Each visit of the same state, with the same outcome, is another decision."""
    first, second = states()
    first.outcome = second.outcome = 'done'
    bench = Bench(two(first, second), autonomy=Autonomy.Low)
    old = bench.decision.id
    for _ in range(2):
        assert bench.confirm() is None
    assert bench.decision.path == '/Inner/First'
    current = bench.decision.id
    assert current != old
    refusal = f'decision {old!r} is not pending any more (pending: {current})'
    assert bench.confirm(old) == refusal
    assert bench.force('/Inner/First', 'failed', old) == refusal
    assert bench.decision.id == current
    assert bench.confirm('') == f"decision '' is not pending any more (pending: {current})"


def test_a_decision_is_overridden_only_where_it_came_up() -> None:
    first, second = states()
    first.outcome = 'done'
    bench = Bench(two(first, second), autonomy=Autonomy.Low)
    decision = bench.decision
    refusal = bench.force('/Inner', 'out', decision.id)
    assert refusal == f'decision {decision.id!r} is about /Inner/First, not about /Inner'
    assert bench.decision == decision


def asking(suggestion: str | None = None) -> Do:
    return lambda state, _: state.ask('Is it safe?', suggestion)


@pytest.mark.parametrize('callback', ['on_enter', 'execute'])
def test_the_operator_chooses_while_the_state_rests(callback: str) -> None:
    state = Scripted('done', 'failed', do={callback: asking()}, rate=10.0)
    bench = Bench(nested(state, 'A/B'), autonomy=Autonomy.Full)
    decision = bench.decision
    assert (decision.kind, decision.path, decision.outcome) == (DecisionKind.CHOICE, '/A/B', '')
    assert (decision.outcomes, decision.required, decision.prompt) == (('done', 'failed'), -1, 'Is it safe?')
    before = list(state.trace)
    state.wake()
    bench.pass_time(60.0)
    assert state.trace == before
    refusal = bench.confirm()
    assert refusal == f'decision {decision.id} suggests nothing: force one of done, failed'
    assert bench.force('/A/B', 'failed', decision.id) is None
    assert bench.outcome == 'failed'
    assert state.trace[-2:] == ['on_exit FORCED', 'on_stop']


@pytest.mark.parametrize('required', [None, *range(4)])
@pytest.mark.parametrize('autonomy', range(4))
def test_a_suggestion_is_taken_alone_when_the_autonomy_allows_it(autonomy: int, required: int | None) -> None:
    state = Scripted('done', 'failed', do={'execute': asking('done')})
    bench = Bench(nested(state, 'A/B', {} if required is None else {'done': required}), autonomy=autonomy)
    if (-1 if required is None else required) < autonomy:
        assert (bench.outcome, bench.run.decisions) == ('done', [])
        return
    decision = bench.decision
    assert (decision.kind, decision.outcome, decision.required) == (DecisionKind.CHOICE, 'done', required)
    assert bench.confirm() is None
    assert bench.outcome == 'done'
    assert state.trace[-2:] == ['on_exit OUTCOME', 'on_stop']


def test_a_choice_is_released_when_the_autonomy_is_raised() -> None:
    state = Scripted('done', 'failed', do={'on_enter': asking('done')})
    bench = Bench(nested(state, 'A', {'done': Autonomy.High}), autonomy=Autonomy.High)
    assert bench.decision.outcome == 'done'
    assert bench.set_autonomy(Autonomy.Full, '/A') is None
    assert bench.outcome == 'done'


def test_a_state_that_asks_and_answers_itself_is_not_asked_about() -> None:
    def ask_and_answer(state: Scripted, _: Any) -> str:
        state.ask('Is it safe?')
        return 'done'

    bench = Bench(nested(Scripted(do={'execute': ask_and_answer}), 'A'))
    assert bench.outcome == 'done'
    assert all(not snapshot.decisions for snapshot in bench.snapshots)


def test_a_question_ends_with_the_visit() -> None:
    questions = iter([asking(), lambda *_: None])
    state = Scripted('again', 'done', do={'on_enter': lambda *arguments: next(questions)(*arguments)})
    bench = Bench(machine(Child('A', state, {'again': 'A', 'done': 'ended'})))
    assert bench.force('/A', 'again') is None
    assert bench.run.decisions == []
    assert state.calls('execute') == 1, 'of the second visit'


def test_a_suggestion_that_is_no_outcome_is_a_fault() -> None:
    bench = Bench(nested(Scripted('done', 'failed', do={'on_enter': asking('nope')}), 'A'))
    assert bench.outcome == 'failed'
    assert "/A: suggests 'nope', which is none of done, failed" in bench.faults[0][1]


def test_commands_that_callbacks_give_are_applied_each_once() -> None:
    def force_next(state: Scripted, _: Any) -> None:
        bench[0].run.command('', force, '/B', 'done')
        bench[0].run.command('', set_autonomy, Autonomy.Off)

    bench: list[Bench] = []
    first = Scripted(do={'on_exit': force_next})
    bench.append(
        Bench(
            machine(
                Child('A', first, {'done': 'B'}),
                Child('B', Scripted(), {'done': 'ended'}),
            )
        )
    )
    first.end('done')
    bench[0].settle()
    assert bench[0].answers == ['/B is not active (active: /A)', None]
    assert bench[0].active == ('/B',)


def test_a_decision_is_about_what_its_state_declares_and_that_of_a_machine_about_its_outputs() -> None:
    def asked(state: Scripted, labels: str, **keys: Any) -> tuple[dict[str, Any], list[str]]:
        names = {'own': 'shared', 'lost': 'absent', 'out': 'more'}
        remap = {key: names[key] for key in (*state.input_keys, *state.output_keys) if key in names}
        inner = machine(Child('S', state, {'done': 'done'}, {'done': Autonomy.Full}, remap), **keys)
        level = {} if labels == 'S' else {'done': Autonomy.Full}
        bench = Bench(
            machine(Child('M', inner, {'done': 'done'}, level), outcomes=['done'], input_keys=['shared', 'absent']),
            userdata={'shared': 7},
        )
        if labels == 'M':
            bench.confirm()
        return bench.run.subject(bench.decision)

    keys = {'outcomes': ['done'], 'input_keys': ['shared', 'absent'], 'defaults': {'more': 1}}
    assert asked(passing(), 'S', **keys) == ({'shared': 7, 'more': 1}, [])
    reads = Scripted(outcome='done', input_keys=['own', 'lost'], output_keys=['out', 'late'])
    assert asked(reads, 'S', **keys) == ({'shared': 7, 'more': 1}, ['absent'])
    assert asked(Scripted(outcome='done', input_keys=['shared']), 'S', **keys) == ({'shared': 7}, [])
    assert asked(passing(), 'M', **keys) == ({'shared': 7, 'more': 1}, [])
    assert asked(passing(), 'M', **keys, output_keys=['more']) == ({'more': 1}, [])
