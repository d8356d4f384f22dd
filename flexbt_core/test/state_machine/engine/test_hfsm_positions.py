# SPDX-License-Identifier: BSD-3-Clause
"""Going on elsewhere: in another run, where one was, and with another machine. Random runs do both as well."""

from __future__ import annotations

import copy
import dataclasses
import json
from typing import Any

import pytest

from flexbt_core.state_machine.authoring.checked_definition import define
from flexbt_core.state_machine.authoring.machine import OperatableStateMachine
from flexbt_core.state_machine.authoring.wrappers import with_retry, with_timeout
from flexbt_core.state_machine.engine.controls import STEPS
from flexbt_core.state_machine.engine.events import (
    DecisionAsked,
    DecisionClosed,
    RunEvent,
    RunReader,
    TransitionBlocked,
    TransitionUnblocked,
)
from flexbt_core.state_machine.engine.resume import RunPosition, position_of, start_at, switch_machine
from flexbt_core.state_machine.model.autonomy import Autonomy
from flexbt_core.state_machine.model.definition import Child
from flexbt_core.state_machine.model.event_state import EventState
from flexbt_core.state_machine.model.userdata import StateError, StateMachineError
from flexbt_testing.state_machines.bench import Bench, Scripted, machine, nested, passing


def line(*states: EventState | OperatableStateMachine, **options: Any) -> OperatableStateMachine:
    """States one after the other."""
    labels = [*(f'S{number}' for number in range(len(states))), 'ended']
    places = [
        Child(labels[number], state, dict.fromkeys(state.outcomes, labels[number + 1]))
        for number, state in enumerate(states)
    ]
    return machine(*places, **options)


def through_json(position: RunPosition) -> RunPosition:
    return RunPosition.from_plain(json.loads(json.dumps(position.to_plain())))


# -- another run, where one was ----------------------------------------------------------------------------------------


def test_a_run_goes_on_with_its_userdata_and_settings_and_tells_the_state_so() -> None:
    def write(_: Scripted, userdata: Any) -> None:
        userdata.x = 7

    def read(state: Scripted, userdata: Any) -> None:
        seen.append((state.is_resumed, userdata.x))

    def made() -> tuple[list[Scripted], OperatableStateMachine]:
        states = [
            Scripted(outcome='done', output_keys=['x'], do={'on_exit': write}),
            Scripted(input_keys=['x'], do={'on_enter': read}),
        ]
        inner = line(*states, io_keys=['x'])
        return states, machine(Child('M', inner, {'ended': 'ended'}), defaults={'x': 0})

    seen: list[Any] = []
    _, first = made()
    before = Bench(first)
    before.lock('/M')
    before.set_breakpoint('/M/S1')
    before.set_autonomy(Autonomy.Low, '/M')
    position = through_json(position_of(before.run))
    assert (position.active, position.userdata) == (('/M', '/M/S1'), {'/': {'x': 7}, '/M': {}})
    states, second = made()
    after = Bench(second, autonomy=Autonomy.Off, at=position)
    assert seen == [(False, 7), (True, 7)]
    assert after.active == before.active
    assert (after.run.locked, after.run.breakpoints, after.run.controls.levels()) == (
        ['/M'],
        ['/M/S1'],
        {'/': 3, '/M': 1},
    )
    assert states[0].trace == ['on_start']
    assert position_of(after.run) == position


@pytest.mark.parametrize('is_switched', [False, True])
def test_what_was_written_to_an_output_is_not_replaced_by_its_default(is_switched: bool) -> None:
    def made() -> OperatableStateMachine:
        write = Scripted(outcome='done', output_keys=['x'], do={'on_exit': lambda _, data: setattr(data, 'x', 7)})
        inner = line(write, Scripted(), output_keys=['x'], defaults={'x': 0})
        return machine(Child('M', inner, {'ended': 'ended'}, {}, {'x': 'result'}), output_keys=['result'])

    bench = Bench(made())
    if is_switched:
        assert bench.switch(made()) is None
    else:
        bench = Bench(made(), at=through_json(position_of(bench.run)))
    assert bench.run.userdata_of_machines() == {'/': {'result': 7}, '/M': {'x': 7}}


def test_what_was_done_and_waited_for_the_operator_is_not_done_again() -> None:
    def made() -> OperatableStateMachine:
        return nested(Scripted(outcome='done'), 'A/B', {'done': Autonomy.Full})

    before = Bench(made())
    old = before.decision
    position = through_json(position_of(before.run))
    shown = {'id': old.id, 'kind': 'TRANSITION', 'path': '/A/B', 'outcome': 'done', 'prompt': ''}
    assert (position.wanted, position.decisions) == ({'/A/B': 'done'}, (shown,))
    after = Bench(made(), at=position)
    assert not [event for event in after.trace if event.startswith('on_enter')]
    assert (after.decision.path, after.decision.outcome) == (old.path, old.outcome)
    assert after.confirm(old.id) is not None, 'the operator has seen another run'
    assert after.confirm() is None
    assert after.outcome == 'done'
    assert not [event for event in after.trace if event.startswith('on_exit')]


def test_a_lock_holds_also_before_the_locked_state_is_entered_again() -> None:
    before = Bench(nested(Scripted(), 'A/B'))
    before.lock('/A/B')
    assert before.force('/A', 'done') is None
    after = Bench(nested(Scripted(), 'A/B'), at=through_json(position_of(before.run)))
    assert after.run.blocked == before.run.blocked == [TransitionBlocked('/A', 'done', ('/A/B',))]
    assert position_of(after.run) == position_of(before.run)
    after.unlock('/A/B')
    assert after.outcome == 'done'


def test_what_was_being_left_is_passed_on() -> None:
    def made(second: Scripted) -> OperatableStateMachine:
        return line(Scripted(outcome='done', do={'halting': lambda *_: 'braking'}), second)

    before = Bench(made(Scripted()))
    second = Scripted()
    position = through_json(position_of(before.run))
    assert position.leaving == {'/S0': 'done'}
    after = Bench(made(second), at=position)
    after.pass_time(3.0)
    assert (second.trace, after.active) == (['on_start', 'on_enter', 'execute'], ('/S1',))


def test_what_was_being_left_to_be_repeated_is_entered_again() -> None:
    def made() -> OperatableStateMachine:
        return line(Scripted(do={'halting': lambda *_: 'braking'}), Scripted())

    before = Bench(made())
    assert before.repeat('/S0') is None
    position = through_json(position_of(before.run))
    assert position.leaving == {'/S0': ''}
    after = Bench(made(), at=position)
    after.pass_time(3.0)
    assert [transition[:3] for transition in after.transitions] == [('/S0', '', '/S0')]
    assert after.trace[-2:] == ['on_enter /S0', 'execute /S0']


def test_what_had_to_wait_for_something_with_priority_is_not_resumed_but_entered() -> None:
    def made(urgent: Scripted, beside: Scripted) -> OperatableStateMachine:
        first = machine(Child('U', urgent, {'done': 'ended'}), priority=True)
        return machine(Child('P', first), Child('B', beside), conditions=[('ended', [('B', 'done')])])

    before = Bench(made(Scripted(), Scripted()))
    position = through_json(position_of(before.run))
    assert (position.active, position.coming) == (('/P', '/P/U'), ('/B',))
    urgent, beside = Scripted(), Scripted()
    after = Bench(made(urgent, beside), at=position)
    assert position_of(after.run) == position
    assert (urgent.trace, beside.trace) == (['on_start', 'on_enter resumed', 'execute'], ['on_start'])
    urgent.end('done')
    after.settle()
    assert beside.trace == ['on_start', 'on_enter', 'execute']


def test_a_paused_run_goes_on_when_it_is_resumed() -> None:
    before = Bench(line(Scripted()))
    before.pause()
    state = Scripted()
    after = Bench(line(state), at=through_json(position_of(before.run)))
    assert (state.trace, after.run.is_paused) == (['on_start'], True)
    assert (after.run.active_states(), after.run.coming()) == ([], ['/S0'])
    assert position_of(after.run) == position_of(before.run)
    after.resume()
    assert state.trace == ['on_start', 'on_enter resumed', 'execute']


def calculation() -> OperatableStateMachine:
    """Return states that pass values down and up through machines that rename them, have own ones, or give defaults."""

    def state(read: str, written: str) -> Scripted:
        def write(state: Scripted, userdata: Any) -> None:
            userdata[written] = [*userdata[read], state.path]

        return Scripted(outcome='done', input_keys=[read], output_keys=[written], do={'execute': write})

    deep = line(state('in', 'own'), state('own', 'out'), input_keys=['in'], output_keys=['out'])
    inner = machine(
        Child('N', deep, {'ended': 'S'}, {}, {'in': 'value', 'out': 'between'}),
        Child('S', state('between', 'result'), {'done': 'D'}),
        Child('D', state('given', 'given'), {'done': 'ended'}),
        input_keys=['value', 'given'],
        output_keys=['result', 'given'],
        defaults={'given': ['default']},
    )
    both = machine(
        Child('A', inner, {}, {}, {'value': 'x', 'result': 'a'}),
        Child('B', line(state('x', 'b'), state('b', 'y'), state('x', 'b'), input_keys=['x'], output_keys=['y', 'b'])),
        conditions=[('ended', [('A', 'ended'), ('B', 'ended')])],
        input_keys=['x'],
        output_keys=['a', 'b', 'y', 'given'],
    )
    return line(state('start', 'x'), both, state('a', 'end'), defaults={'start': []})


def test_a_run_calculates_the_same_wherever_it_was_interrupted_or_switched() -> None:
    """Continue at each moment from the position that was written down, or switch there: no value changes."""

    class Whole(Bench):
        events = 0

        def read(self, event: RunEvent) -> None:
            super().read(event)
            self.events += 1
            if self.run.outcome is None and not self.run.message:
                positions.append(through_json(position_of(self.run)))

    class Switched(Bench):
        def read(self, event: RunEvent) -> None:
            super().read(event)
            if next(countdown, None) == 0:
                self.run.command('', switch_machine, define(calculation()))

    positions: list[RunPosition] = []
    whole = Whole(calculation())
    assert (whole.outcome, len(positions) > 40) == ('ended', True)
    assert whole.run.userdata()['end'] == ['/S0', '/S1/A/N/S0', '/S1/A/N/S1', '/S1/A/S', '/S2']
    for position in positions[1:]:
        after = Bench(calculation(), at=position)
        assert (after.outcome, after.run.userdata()) == ('ended', whole.run.userdata())
    answers = list[str | None]()
    for number in range(whole.events):
        countdown = iter(range(number, -1, -1))
        after = Switched(calculation())
        assert (after.outcome, after.run.userdata()) == ('ended', whole.run.userdata())
        assert after.run.scope.writers == whole.run.scope.writers
        answers += after.answers
    assert answers.count(None) > 20


@pytest.mark.parametrize(
    ('change', 'reason'),
    [
        (
            {'active': ['/S0', '/S1']},
            'one state of / has to be active, not /S0, /S1; one state of /S1 has to be active, not none',
        ),
        ({'active': []}, 'one state of / has to be active, not none'),
        ({'active': ['/S7']}, "the machine has no state '/S7'; one state of / has to be active, not none"),
        ({'active': ['/S1']}, 'one state of /S1 has to be active, not none'),
        ({'userdata': {}}, 'the userdata of / is missing'),
        ({'active': ['/S0', '/S0/A']}, "the machine has no state '/S0/A'; /S0 cannot have anything active in it"),
        ({'wanted': {'/S0': 'x'}}, "/S0 has no outcome 'x'"),
        ({'levels': {'/': 4}}, "there is no level 4 of '/'"),
        ({'locked': ['/x']}, "the machine has no state '/x'"),
        ({'step': 'up /S0'}, "there is no step 'up /S0'"),
    ],
)
def test_a_position_that_cannot_be_is_refused(change: dict[str, Any], reason: str) -> None:
    def made() -> OperatableStateMachine:
        return line(Scripted(), nested(Scripted(), 'A'))

    plain = position_of(Bench(made()).run).to_plain() | change
    bench = Bench(made(), start=False)
    with pytest.raises(StateMachineError) as caught:
        start_at(bench.run, RunPosition.from_plain(plain))
    assert str(caught.value) == f'the run cannot continue there: {reason}'


def test_a_position_does_not_change_with_what_was_written_of_it() -> None:
    position = position_of(Bench(line(Scripted(), defaults={'x': 1})).run)
    position = dataclasses.replace(position, decisions=({'id': '1'},))
    plain = position.to_plain()
    written = copy.deepcopy(plain)
    plain['decisions'][0].clear()
    for value in plain.values():
        if isinstance(value, dict | list):
            value.clear()
    assert position.to_plain() == written != plain


def test_a_run_that_has_not_begun_has_no_userdata_of_machines() -> None:
    assert Bench(line(Scripted(), defaults={'x': 1}), start=False).run.userdata_of_machines() == {}


def test_data_that_is_no_position_is_refused() -> None:
    plain = position_of(Bench(line(Scripted())).run).to_plain()
    for name, value in plain.items():
        wrong = copy.deepcopy(plain)
        for wrong[name] in (3.5, -1):
            with pytest.raises(StateMachineError, match=f'this is not a position of a run: {name} cannot be '):
                RunPosition.from_plain(wrong)
        del wrong[name]
        with pytest.raises(StateMachineError, match=f': missing or left over: {name}$'):
            RunPosition.from_plain(wrong)
        assert value is not None


# -- another machine ---------------------------------------------------------------------------------------------------


def test_a_switch_keeps_the_active_state_and_its_data_and_follows_the_new_transitions() -> None:
    state = Scripted(
        'done', io_keys=['x'], do={'execute': lambda _, userdata: userdata.__setitem__('x', userdata.x + 1)}
    )
    inner = machine(Child('A', state, {'done': 'ended'}), io_keys=['x'])
    bench = Bench(machine(Child('M', inner, {'ended': 'ended'}), defaults={'x': 1}))
    follow, replaced = Scripted(), Scripted('done', io_keys=['x'])
    inner = machine(
        Child('A', replaced, {'done': 'B'}),
        Child('B', follow, {'done': 'C'}),
        Child('C', passing(outcomes=['e', 'n']), {'e': 'ended', 'n': 'new'}),
        outcomes=['ended', 'new'],
        io_keys=['x'],
    )
    made = machine(Child('M', inner, {'ended': 'ended', 'new': 'ended'}), defaults={'x': 100, 'y': 5})
    assert bench.switch(made) is None
    assert (bench.active, state.trace[-1]) == (('/M/A',), 'execute')
    assert (bench.run.userdata(), replaced.trace, follow.trace) == ({'x': 2, 'y': 5}, ['on_start'], ['on_start'])
    assert bench.run.definition.children['M'].outcomes == ('ended', 'new')
    state.end('done')
    state.wake()
    bench.settle()
    assert bench.active == ('/M/B',)
    assert state.trace[-1] == 'on_exit OUTCOME'
    bench.repeat('/M')
    assert state.trace[-1] == 'on_stop', 'the new object takes over when the state is entered again'
    assert replaced.trace == ['on_start', 'on_enter', 'execute']
    bench.stop()
    for one in (state, follow, replaced):
        assert (one.calls('on_start'), one.calls('on_stop')) == (1, 1)
        assert one.calls('on_enter') == one.calls('on_exit')


def test_what_waits_for_the_operator_is_asked_again_after_a_switch() -> None:
    bench = Bench(line(Scripted(outcome='done'), passing()), autonomy=Autonomy.Full)
    assert bench.outcome == 'ended'
    made = [machine(Child('A', Scripted(outcome='done'), {'done': 'ended'}, {'done': Autonomy.Full})) for _ in range(2)]
    bench = Bench(made[0])
    old = bench.decision
    assert bench.switch(made[1]) is None
    assert bench.confirm(old.id) is not None
    assert bench.confirm() is None
    assert bench.outcome == 'ended'


@pytest.mark.parametrize('how', STEPS)
def test_what_a_step_holds_waits_also_after_a_crash_and_after_a_switch(how: str) -> None:
    def made() -> OperatableStateMachine:
        inner = line(passing(), passing())
        return machine(Child('M', inner, {'ended': 'Z'}), Child('Z', passing(), {'done': 'ended'}))

    before = Bench(made(), start=False)
    before.run.controls.breakpoints.add('/M/S0')
    before.run.start()
    before.settle()
    assert before.step_by(how, before.decision.id) is None
    held = before.decision.path
    assert held == ('/M' if how == 'out' else '/M/S1')
    after = Bench(made(), at=through_json(position_of(before.run)))
    assert after.decision.path == held
    assert before.switch(made()) is None
    for bench in (after, before):
        assert (bench.decision.path, str(bench.run.controls.step)) == (held, f'{how} /M/S0')
        assert bench.confirm() is None
        assert bench.outcome == 'ended'


@pytest.mark.parametrize('is_waiting', [False, True])
def test_each_wait_ends_at_a_switch_and_begins_again_if_the_other_machine_waits_too(is_waiting: bool) -> None:
    class Waits(RunReader):
        reads = (DecisionAsked, DecisionClosed, TransitionBlocked, TransitionUnblocked)

        def read(self, event: RunEvent) -> None:
            told.append(event)

    def made(is_waiting: bool) -> OperatableStateMachine:
        inner = line(Scripted()) if is_waiting else line(Scripted(), Scripted())
        return machine(
            Child('A', Scripted(outcome='done'), {}, {'done': Autonomy.Full if is_waiting else Autonomy.Off}),
            Child('M', inner),
            conditions=[('ended', [('A', 'done'), ('M', 'ended')])],
        )

    told: list[RunEvent] = []
    bench = Bench(made(True))
    asked, blocked = bench.decision, TransitionBlocked('/M/S0', 'done', ('/M',))
    bench.lock('/M')
    bench.force('/M/S0', 'done')
    assert bench.run.blocked == [blocked]
    bench.run.add_reader(Waits())
    assert bench.switch(made(is_waiting)) is None
    assert told[:2] == [DecisionClosed(asked), TransitionUnblocked('/M/S0')]
    if is_waiting:
        assert told[2:] == [DecisionAsked(bench.decision), blocked]
    else:
        assert (told[2:], bench.active) == ([], ('/M/S1',))


class Other(Scripted):
    """Another kind of state."""


@pytest.mark.parametrize(
    ('made', 'reason'),
    [
        (
            machine(Child('B', Scripted(), {'done': 'ended'})),
            "the machine has no state '/A'; one state of / has to be active, not none",
        ),
        (
            machine(Child('A', Other(), {'done': 'ended'})),
            f'/A is active, and would be of class {__name__}.Other '
            'instead of flexbt_testing.state_machines.bench.Scripted',
        ),
        (
            machine(Child('A', Scripted('done', 'x', 'y'), {'done': 'ended', 'x': 'ended', 'y': 'ended'})),
            '/A is active, and would have other outcomes (x, y)',
        ),
        (
            machine(Child('A', Scripted(output_keys=['k']), {'done': 'ended'})),
            '/A is active, and would have other output keys (k)',
        ),
        (
            machine(Child('A', nested(Scripted(), 'B'), {'done': 'ended'})),
            'one state of /A has to be active, not none; '
            '/A is active, and would be a container of kind MACHINE instead of a state',
        ),
        (
            machine(Child('A', Scripted(), {}), conditions=[('ended', [('A', 'done')])]),
            '/ is active, and would be a container of kind CONCURRENCY instead of a container of kind MACHINE',
        ),
        (
            machine(
                Child('A', Scripted(), {'done': 'B'}),
                Child('B', Scripted(input_keys=['k']), {'done': 'ended'}),
                input_keys=['k'],
            ),
            "nobody has given the input 'k'",
        ),
    ],
)
def test_a_switch_that_cannot_be_is_refused_and_changes_nothing(made: OperatableStateMachine, reason: str) -> None:
    state = Scripted()
    bench = Bench(machine(Child('Before', passing(), {'done': 'A'}), Child('A', state, {'done': 'ended'})))
    before = bench.run.definition
    assert bench.switch(made) == f'the run cannot continue with that machine: {reason}'
    assert (bench.run.definition, bench.active) == (before, ('/A',))
    state.end('done')
    bench.settle()
    assert bench.outcome == 'ended'


def test_a_switch_looks_at_the_states_in_their_time_outs_and_attempts() -> None:
    def made(state: EventState) -> OperatableStateMachine:
        return machine(Child('A', state, dict.fromkeys(state.outcomes, 'ended')))

    bench = Bench(made(with_timeout(Scripted(), 9.0)))
    assert 'Other instead of' in (bench.switch(made(with_timeout(Other(), 9.0))) or '')
    bench = Bench(made(Scripted()))
    assert bench.switch(made(with_retry(Scripted(), 2, on=['done']))) is None


def test_a_switch_is_refused_while_something_is_left_and_when_a_new_state_cannot_start() -> None:
    def boom(*_: Any) -> None:
        raise ArithmeticError

    broken = Scripted(do={'on_start': boom})
    fine = Scripted()
    bench = Bench(line(Scripted(), fine))
    assert bench.switch(line(Scripted(), broken)) == 'the run cannot continue with that machine: /S1 raised in on_start'
    assert broken.trace == ['on_start', 'on_stop']
    other = Bench(line(Scripted(do={'halting': lambda *_: 'braking'}), Scripted()))
    other.force('/S0', 'done')
    refusal = other.switch(line(Scripted(), Scripted()))
    assert refusal == 'the run cannot continue with that machine: /S0 is being left; try again when it has halted'
    taken = line(Scripted(), fine)
    refusal = other.switch(taken)
    assert refusal is not None
    assert '/S1: its state is part of a run already' in refusal


@pytest.mark.parametrize('reads', [(), ('k',)])
@pytest.mark.parametrize('defaults', [{}, {'k': 2}])
@pytest.mark.parametrize('given', [{}, {'k': 1}])
def test_inputs_of_the_new_machine_come_from_the_userdata_or_its_defaults(
    given: dict[str, int], defaults: dict[str, int], reads: tuple[str, ...]
) -> None:
    bench = Bench(line(Scripted()), userdata=given)
    made = line(Scripted(), Scripted(input_keys=reads), input_keys=['k'], defaults=defaults)
    is_missing = bool(reads) and not given and not defaults
    assert (bench.switch(made) is not None) is is_missing
    assert bench.run.userdata() == {**defaults, **given}


def test_what_had_ended_beside_the_active_states_is_remembered_unless_it_is_gone() -> None:
    def made(*labels: str, needed: str) -> OperatableStateMachine:
        children = [Child(label, passing() if label in 'AB' else Scripted()) for label in labels]
        return machine(*children, conditions=[('ended', [(label, 'done') for label in needed])])

    bench = Bench(made('A', 'B', 'C', needed='ABC'))
    assert position_of(bench.run).ended == {'/A': 'done', '/B': 'done'}
    assert bench.switch(made('B', 'C', 'D', needed='BC')) is None
    assert (position_of(bench.run).ended, bench.active) == ({'/B': 'done'}, ('/C', '/D'))
    assert bench.force('/C', 'done') is None
    assert bench.outcome == 'ended'


def test_a_switch_to_conditions_that_hold_already_is_refused() -> None:
    def made(*needed: str) -> OperatableStateMachine:
        children = Child('A', passing()), Child('B', Scripted())
        both = machine(*children, conditions=[('ended', [(label, 'done') for label in needed])])
        return machine(Child('C', both, {'ended': 'ended'}))

    bench = Bench(made('A', 'B'))
    refusal = "/C would be over, by 'ended', with the children that have ended; let it end first"
    assert bench.switch(made('A')) == f'the run cannot continue with that machine: {refusal}'
    assert bench.active == ('/C/B',)
    assert bench.switch(made('B')) is None
    assert bench.force('/C', 'ended') is None
    assert bench.outcome == 'ended'


def test_settings_of_what_both_machines_have_stay() -> None:
    bench = Bench(line(Scripted(), nested(Scripted(), 'A')))
    bench.lock('/S1/A')
    bench.lock('/S0')
    bench.set_breakpoint('/S1')
    bench.set_breakpoint('/S1/A')
    bench.set_autonomy(Autonomy.Low, '/S1')
    assert bench.switch(line(Scripted(), nested(Scripted(), 'B'))) is None
    assert (bench.run.locked, bench.run.breakpoints) == (['/S0'], ['/S1'])
    assert bench.run.controls.levels() == {'/': 3, '/S1': 1}


def test_a_run_whose_states_are_taken_binds_none_of_them() -> None:
    taken = Scripted()
    first = Bench(line(taken))
    free = Scripted()
    second = Bench(line(free, taken), start=False)
    with pytest.raises(StateError, match='/S1: the state is part of a run that has not ended'):
        second.run.start()
    assert Bench(line(free)).active == ('/S0',)
    assert first.active == ('/S0',)
