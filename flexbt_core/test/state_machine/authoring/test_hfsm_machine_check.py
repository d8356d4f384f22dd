# SPDX-License-Identifier: BSD-3-Clause
"""The check of a machine when it is built: all of its problems in one report, each with its place and a remedy."""

from __future__ import annotations

import threading
from typing import Any

import pytest

from flexbt_core.state_machine.authoring.checked_definition import define
from flexbt_core.state_machine.authoring.machine import OperatableStateMachine
from flexbt_core.state_machine.model.autonomy import Autonomy
from flexbt_core.state_machine.model.definition import Child, StateKind
from flexbt_core.state_machine.model.event_state import EventState, state_skill
from flexbt_core.state_machine.model.userdata import MachineError, MachineProblem, StateMachineError
from flexbt_testing.state_machines.bench import Bench, Scripted, machine
from flexbt_testing.waiting import DEADLINE

END = {'done': 'ended'}


def problems(made: OperatableStateMachine) -> tuple[str, ...]:
    with pytest.raises(MachineError) as caught:
        define(made)
    assert str(caught.value) == '; '.join(caught.value.problems)
    return caught.value.problems


def keyed(inputs: str = '', outputs: str = '') -> Scripted:
    return Scripted(input_keys=inputs.split(), output_keys=outputs.split())


@pytest.mark.parametrize(
    ('places', 'options', 'problem'),
    [
        ([], {}, '/: the machine has no states'),
        ([Child('A', Scripted(), {'done': 'A'})], {'outcomes': []}, '/: the machine has no outcomes'),
        ([Child('A', Scripted(), {})], {}, "/A: the outcome 'done' leads nowhere; add it to transitions"),
        (
            [Child('A', Scripted(), {'done': 'endet'})],
            {},
            "/A: the outcome 'done' leads to 'endet', which is neither a state nor an outcome of the machine; "
            "did you mean 'ended'?",
        ),
        (
            [Child('A', Scripted(), END | {'dome': 'ended'})],
            {},
            "/A: transition of 'dome', which is not an outcome of it; did you mean 'done'?",
        ),
        ([Child('A', Scripted(), END, {'x': 1})], {}, "/A: autonomy of 'x', which is not an outcome of it (done)"),
        (
            [Child('A', Scripted(), END, {'done': 4})],
            {},
            "/A: autonomy 4 of 'done' is none of the levels Off 0, Low 1, High 2, Full 3",
        ),
        (
            [Child('A', keyed('goal'), END, {}, {'gaol': 'x'})],
            {'input_keys': ['goal']},
            "/A: remaps 'gaol', which is none of its keys; did you mean 'goal'?",
        ),
        ([Child('A', Scripted(), {'done': 'A'}), Child('A', Scripted(), END)], {}, "/A: the label 'A' is used twice"),
        (
            [Child('ended', Scripted(), {'done': 'ended'})],
            {},
            "/ended: 'ended' is both a state and an outcome of its machine, so that a transition to it is ambiguous",
        ),
        (
            [Child('A', Scripted(), END), Child('B', Scripted(), END)],
            {},
            '/B: no transition leads to it from the initial state',
        ),
        (
            [Child('A', Scripted(), {'done': 'preempted'})],
            {'outcomes': ['preempted']},
            "/: the outcome 'preempted' is reserved for runs that were stopped or failed; rename it",
        ),
        (
            [Child('A', Scripted(), {'done': 'error'})],
            {'outcomes': ['error']},
            "/: the outcome 'error' is reserved for runs that were stopped or failed; rename it",
        ),
        (
            [Child('A', keyed('_x'), END)],
            {'input_keys': ['_x']},
            "/: '_x' cannot be a userdata key: it is empty or begins with an underscore",
        ),
        (
            [Child('A', keyed('', '_x'), END)],
            {},
            "/A: '_x' cannot be a userdata key: it is empty or begins with an underscore",
        ),
        (
            [Child('A', Scripted(), END)],
            {'output_keys': ['result']},
            "/: the output key 'result' of the machine is written by none of its states",
        ),
    ],
)
def test_a_problem_is_named_with_its_place(places: list[Child], options: dict[str, Any], problem: str) -> None:
    assert problem in problems(machine(*places, **options))


@pytest.mark.parametrize('label', ['', 'A/B', ' A', 'A ', '/'])
def test_a_label_that_cannot_be_part_of_a_path_is_refused(label: str) -> None:
    assert any(f"'{label}' cannot be a label" in one for one in problems(machine(Child(label, Scripted(), END))))


def test_a_key_that_nobody_can_have_written_is_named_with_both_ends() -> None:
    inner = machine(Child('Use', keyed('pose'), END), input_keys=['pose'])
    made = machine(
        Child('Find', keyed('', 'place'), {'done': 'Go'}),
        Child('Go', inner, {'ended': 'ended'}, {}, {'pose': 'plaza'}),
    )
    assert problems(made) == (
        "/Go: reads userdata key 'pose' (remapped to 'plaza'); no state of / writes it, and it is neither an input nor "
        "a default of the machine; did you mean 'place'?",
    )


@pytest.mark.parametrize('source', ['input', 'default', 'sibling', 'own default'])
def test_a_key_may_come_from_an_input_a_default_a_sibling_or_a_default_of_its_own(source: str) -> None:
    seen: list[Any] = []
    use = Scripted(outcome='done', do={'execute': lambda _, userdata: seen.append(userdata.key)}, input_keys=['key'])
    own = {'key': 1} if source == 'own default' else {}
    inner = machine(Child('Use', use, END), input_keys=['key'], defaults=own)
    give = Scripted(
        outcome='done',
        do={'execute': lambda _, userdata: userdata.__setitem__('key', 1)} if source == 'sibling' else {},
        output_keys=['key'] if source == 'sibling' else [],
    )
    made = machine(
        Child('Give', give, {'done': 'Inner'}),
        Child('Inner', inner, {'ended': 'ended'}),
        input_keys=['key'] if source == 'input' else [],
        defaults={'key': 1} if source == 'default' else {},
    )
    bench = Bench(made, userdata={'key': 1} if source == 'input' else {})
    assert (bench.outcome, seen, bench.faults) == ('ended', [1], [])


def test_all_problems_of_all_levels_are_in_one_report() -> None:
    inner = machine(
        Child('One', Scripted(), {'done': 'Two'}),
        Child('Lost', keyed('x'), {'done': 'ended'}),
    )
    made = machine(
        Child('First', Scripted('error'), {'error': 'Inner'}, {'nope': 9}),
        Child('Inner', inner, {'ended': 'nowhere'}),
        output_keys=['y'],
    )
    expected = [
        ('/First', "autonomy of 'nope'"),
        ('/First', "autonomy 9 of 'nope'"),
        ('/Inner', "leads to 'nowhere'"),
        ('/', "output key 'y'"),
        ('/Inner/One', "leads to 'Two'"),
        ('/Inner/Lost', 'no transition leads to it'),
        ('/Inner/Lost', "reads userdata key 'x'"),
    ]
    for problem, (path, words) in zip(problems(made), expected, strict=True):
        assert problem.startswith(f'{path}: ')
        assert words in problem


@pytest.mark.parametrize('level', ['low', 4, -2, None])
def test_a_level_for_all_outcomes_of_a_machine_that_is_none_is_refused(level: Any) -> None:
    inner = OperatableStateMachine(['ended'], autonomy=level, children=[Child('A', Scripted(), END)])
    made = machine(Child('In', inner, {'ended': 'ended'}))
    assert problems(made) == (f'/In: autonomy {level} is none of the levels Off 0, Low 1, High 2, Full 3',)


def test_one_object_in_two_places_is_refused() -> None:
    state = Scripted()
    inner = machine(Child('C', state, END))
    made = machine(Child('A', state, {'done': 'B'}), Child('B', inner, {'ended': 'ended'}))
    assert problems(made) == ('/B/C: the same state object is also /A; make one for each place',)


def test_a_machine_in_itself_is_refused_once() -> None:
    made = machine(Child('A', Scripted(), {'done': 'B'}))
    with made:
        OperatableStateMachine.add('B', made, {'ended': 'ended'})
    assert problems(made) == ('/B: the same state object is also /; make one for each place',)


@pytest.mark.parametrize('state', [Scripted, None, 'Scripted', object()])
def test_what_is_no_state_cannot_be_added(state: Any) -> None:
    made = OperatableStateMachine(outcomes=['ended'])
    with made, pytest.raises(StateMachineError, match=r"cannot add 'A': .* is neither a state object nor a machine"):
        OperatableStateMachine.add('A', state, END)


def test_without_an_open_machine_nothing_can_be_added() -> None:
    made = OperatableStateMachine(outcomes=['ended'])
    with pytest.raises(ArithmeticError), made:
        raise ArithmeticError
    with pytest.raises(StateMachineError, match="cannot add 'A': no machine is open"):
        OperatableStateMachine.add('A', Scripted(), END)


def test_machines_are_built_in_threads_at_the_same_time() -> None:
    def build(number: int) -> None:
        with made[number]:
            barrier.wait(DEADLINE)
            OperatableStateMachine.add(f'S{number}', Scripted(), END)
            barrier.wait(DEADLINE)

    made = [OperatableStateMachine(outcomes=['ended']) for _ in range(2)]
    barrier = threading.Barrier(2)
    threads = [threading.Thread(target=build, args=(number,)) for number in range(2)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join(DEADLINE)
    assert [[child.label for child in one.children] for one in made] == [['S0'], ['S1']]


def test_a_definition_does_not_change_with_what_it_was_made_of() -> None:
    transitions, autonomy = {'done': 'ended'}, {'done': Autonomy.High}
    made = machine(Child('A', Scripted(), transitions, autonomy), defaults={'x': 1})
    definition = define(made)
    before = definition.structure()
    transitions['done'] = 'A'
    autonomy['done'] = Autonomy.Off
    made.userdata['x'] = 2
    with made:
        OperatableStateMachine.add('B', Scripted(), END)
    assert definition.structure() == before
    assert definition.defaults == {'x': 1}


def test_the_structure_says_where_each_outcome_leads_and_what_it_requires() -> None:
    inner = machine(Child('C', Scripted('x', 'y'), {'x': 'C', 'y': 'out'}, {'y': Autonomy.Full}), outcomes=['out'])
    made = machine(Child('A', Scripted(), {'done': 'B'}), Child('B', inner, {'out': 'ended'}, {'out': Autonomy.Off}))
    shown = [
        (one.path, one.kind, one.children, one.outcomes, one.targets, one.autonomy) for one in define(made).structure()
    ]
    assert shown == [
        ('/', StateKind.MACHINE, ('A', 'B'), ('ended',), ('',), (-1,)),
        ('/A', StateKind.STATE, (), ('done',), ('/B',), (-1,)),
        ('/B', StateKind.MACHINE, ('C',), ('out',), ('=ended',), (0,)),
        ('/B/C', StateKind.STATE, (), ('x', 'y'), ('/B/C', '=out'), (-1, 3)),
    ]


def test_a_state_or_an_inner_machine_may_use_the_names_of_the_ends_of_runs() -> None:
    """In FlexBE an outcome 'preempted' of any state ends the whole behavior, whatever it is connected to."""
    inner = machine(Child('One', Scripted('error', outcome='error'), {'error': 'preempted'}), outcomes=['preempted'])
    bench = Bench(machine(Child('Inner', inner, {'preempted': 'Last'}), Child('Last', Scripted(), END)))
    assert (bench.outcome, bench.active) == (None, ('/Last',))


def test_an_input_of_a_container_that_nothing_reads_need_not_be_given() -> None:
    def inner(*read: str, outputs: tuple[str, ...] = (), writes: tuple[str, ...] = ()) -> OperatableStateMachine:
        state = Scripted(input_keys=list(read), output_keys=list(writes))
        return machine(Child('Go', state, END), input_keys=['used', 'unused'], output_keys=list(outputs))

    assert define(machine(Child('In', inner(), {'ended': 'ended'}))).input_keys == ()
    assert define(machine(Child('In', inner(outputs=('unused',), writes=('unused',)), {'ended': 'ended'})))
    for made, key in ((inner('used'), 'used'), (inner(outputs=('unused',)), 'unused')):
        with pytest.raises(MachineError, match=f"/In: reads userdata key '{key}'"):
            define(machine(Child('In', made, {'ended': 'ended'})))


@pytest.mark.parametrize(
    'make',
    [
        lambda: EventState(outcomes=[True]),  # type: ignore[list-item]
        lambda: EventState(outcomes=['done'], input_keys=[5]),  # type: ignore[list-item]
        lambda: OperatableStateMachine(outcomes=[None]),  # type: ignore[list-item]
        lambda: OperatableStateMachine(outcomes=['ended'], output_keys=[b'x']),  # type: ignore[list-item]
        lambda: machine(Child(5, Scripted(), {'done': 'ended'})),  # type: ignore[arg-type]
    ],
)
def test_names_that_are_no_text_are_refused_since_no_message_can_have_them(make: Any) -> None:
    with pytest.raises(StateMachineError, match='it is not text; in YAML, quote it'):
        make()


def test_a_refused_machine_has_records_for_programs() -> None:
    error = MachineError(['one; mend it', MachineProblem('/A', 'two')])
    assert str(error) == 'one; mend it; /A: two'
    told = [{key: record[key] for key in ('rule', 'severity', 'node', 'message', 'fix')} for record in error.records]
    refused = {'rule': 'refused', 'severity': 'error'}
    assert told == [
        refused | {'node': '', 'message': 'one; mend it', 'fix': 'mend it'},
        refused | {'node': '/A', 'message': 'two', 'fix': ''},
    ]


@pytest.mark.parametrize('is_instant', [True, False])
def test_an_instant_state_takes_no_time(is_instant: bool) -> None:
    class Own(Scripted):
        pass

    Own.is_instant = is_instant
    skill = state_skill(Own('done', 'failed', input_keys=['a'], output_keys=['b']))
    assert (skill.name, skill.reads, skill.writes, tuple(skill.outcomes)) == ('Own', ('a',), ('b',), ('done', 'failed'))
    assert skill.duration == (0.0, 0.0 if is_instant else None)
