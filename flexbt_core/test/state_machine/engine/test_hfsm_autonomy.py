# SPDX-License-Identifier: BSD-3-Clause
"""Which transitions happen without the operator: FlexBE's table, at each level of nesting, and changed at run time."""

from __future__ import annotations

import itertools

import pytest

from flexbt_core.state_machine.authoring.checked_definition import define
from flexbt_core.state_machine.authoring.machine import OperatableStateMachine, PriorityContainer
from flexbt_core.state_machine.model.autonomy import Autonomy
from flexbt_core.state_machine.model.definition import Child, MachineDefinition
from flexbt_core.state_machine.model.userdata import StateMachineError
from flexbt_testing.state_machines.bench import Bench, Scripted, machine, nested, passing

LEVELS = (Autonomy.Off, Autonomy.Low, Autonomy.High, Autonomy.Full)
UNDECLARED = -1
PASSES = {
    (required, current): required < current for required, current in itertools.product((UNDECLARED, *LEVELS), LEVELS)
}
BLOCKED_AT = {UNDECLARED: 0, Autonomy.Off: 1, Autonomy.Low: 2, Autonomy.High: 3, Autonomy.Full: 4}


def gated(required: int, *, on_machine: bool) -> OperatableStateMachine:
    """Return a state that ends at once, in a machine; the outcome of one of the two requires a level."""
    level = {'done': required} if required != UNDECLARED else {}
    inner = machine(Child('B', passing(), {'done': 'done'}, {} if on_machine else level), outcomes=['done'])
    return machine(Child('A', inner, {'done': 'ended'}, level if on_machine else {}))


def test_the_table_blocks_as_many_levels_as_is_required() -> None:
    for required, blocked in BLOCKED_AT.items():
        assert [PASSES[required, current] for current in LEVELS] == [False] * blocked + [True] * (4 - blocked)


@pytest.mark.parametrize('on_machine', [False, True])
@pytest.mark.parametrize(('required', 'current'), PASSES)
def test_a_transition_happens_alone_iff_it_requires_less_than_there_is(
    required: int, current: int, on_machine: bool
) -> None:
    bench = Bench(gated(required, on_machine=on_machine), autonomy=current)
    if PASSES[required, current]:
        assert bench.outcome == 'ended'
        assert all(not snapshot.decisions for snapshot in bench.snapshots)
        return
    assert bench.outcome is None
    decision = bench.decision
    assert (decision.path, decision.outcome) == ('/A' if on_machine else '/A/B', 'done')
    assert (decision.required, decision.outcomes) == (required, ('done',))
    assert bench.snapshots[-1].decisions == (decision,), 'the operator was told'
    bench.pass_time(1000.0)
    assert bench.decision == decision
    assert bench.confirm() is None
    assert bench.outcome == 'ended'


@pytest.mark.parametrize('on_machine', [False, True])
@pytest.mark.parametrize('required', LEVELS)
def test_a_level_that_is_raised_releases_what_waits_as_soon_as_it_allows_it(required: int, on_machine: bool) -> None:
    bench = Bench(gated(required, on_machine=on_machine), autonomy=Autonomy.Off)
    decision = bench.decision
    for current in LEVELS:
        assert bench.set_autonomy(current) is None
        assert (bench.outcome == 'ended') is PASSES[required, current]
        if bench.outcome is not None:
            assert bench.snapshots[-1].decisions == ()
            return
        assert bench.decision == decision, 'the same decision, as nothing has happened'
    assert required == Autonomy.Full


def ring_of(*states: Scripted, required: int) -> OperatableStateMachine:
    """States in machines of their own, one after the other and over again."""
    labels = [f'M{number}' for number in range(len(states))]
    return machine(
        *(
            Child(label, nested(state, 'S', {'done': required}), {'done': labels[(number + 1) % len(labels)]})
            for number, (label, state) in enumerate(zip(labels, states, strict=True))
        )
    )


@pytest.mark.parametrize('kind', [OperatableStateMachine, PriorityContainer])
def test_what_has_no_level_of_its_own_has_that_of_its_machine(kind: type[OperatableStateMachine]) -> None:
    children = [
        Child('A', passing(), {'done': 'B'}),
        Child('B', passing(), {'done': 'C'}, {'done': Autonomy.Low}),
        Child('C', machine(Child('D', passing(), {'done': 'done'}), outcomes=['done']), {'done': 'done'}),
    ]
    made = define(kind(outcomes=['done'], children=children, autonomy=Autonomy.High))
    assert [one.transitions['done'].autonomy for one in made.children.values()] == [2, 1, 2]
    inner = made.children['C']
    assert isinstance(inner, MachineDefinition) and inner.children['D'].transitions['done'].autonomy == UNDECLARED


def test_a_level_that_is_lowered_blocks_what_comes_after() -> None:
    states = [Scripted(), Scripted()]
    bench = Bench(ring_of(*states, required=Autonomy.Low), autonomy=Autonomy.High)
    states[0].end('done')
    bench.settle()
    assert bench.active == ('/M1/S',)
    assert bench.set_autonomy(Autonomy.Low) is None
    assert bench.run.decisions == []
    states[1].end('done')
    bench.settle()
    assert bench.active == ('/M1/S',)
    assert bench.decision.path == '/M1/S'


def test_a_sub_tree_has_a_level_of_its_own_until_one_is_set_for_what_is_around_it() -> None:
    states = [Scripted(outcome='done'), Scripted()]
    bench = Bench(ring_of(*states, required=Autonomy.Low), autonomy=Autonomy.Off)
    assert bench.decision.path == '/M0/S'
    assert bench.set_autonomy(Autonomy.High, '/M1') is None
    assert bench.active == ('/M0/S',), 'not its business'
    assert bench.set_autonomy(Autonomy.High, '/M0/S') is None
    assert bench.active == ('/M1/S',)
    levels = {path: bench.run.controls.level(path) for path in ('/', '/M0', '/M0/S', '/M1', '/M1/S')}
    assert levels == {'/': 0, '/M0': 0, '/M0/S': 2, '/M1': 2, '/M1/S': 2}
    assert bench.set_autonomy(Autonomy.Low, '/M0') is None
    assert bench.run.controls.level('/M0/S') == Autonomy.Low, 'what is set for a machine holds for all that is in it'
    assert bench.run.controls.level('/M1/S') == Autonomy.High
    assert bench.set_autonomy(Autonomy.Full, '/') is None
    assert {bench.run.controls.level(path) for path in levels} == {Autonomy.Full}


def test_a_path_that_only_begins_alike_is_not_in_the_sub_tree() -> None:
    bench = Bench(
        machine(Child('A', Scripted(), {'done': 'AB'}), Child('AB', Scripted(), {'done': 'ended'})),
        autonomy=Autonomy.Off,
    )
    assert bench.set_autonomy(Autonomy.Full, '/A') is None
    assert [bench.run.controls.level(path) for path in ('/', '/A', '/AB')] == [0, 3, 0]


@pytest.mark.parametrize('level', [-1, 4, 255])
def test_a_level_that_is_none_is_refused(level: int) -> None:
    bench = Bench(nested(Scripted(), 'A'), autonomy=Autonomy.Low)
    refusal = bench.set_autonomy(level)
    assert refusal == f'autonomy {level} is none of the levels Off 0, Low 1, High 2, Full 3'
    assert bench.run.controls.level('/A') == Autonomy.Low
    with pytest.raises(StateMachineError, match=f'autonomy {level} is none'):
        Bench(nested(Scripted(), 'A'), autonomy=level)


@pytest.mark.parametrize('path', ['/B', 'A', '/A/', '//'])
def test_a_path_that_is_none_is_refused(path: str) -> None:
    bench = Bench(nested(Scripted(), 'A'))
    assert bench.set_autonomy(Autonomy.Off, path) == f'there is no state {path!r}'
    assert bench.run.controls.level('/A') == Autonomy.Full


def test_two_runs_of_one_machine_have_levels_of_their_own() -> None:
    made = gated(Autonomy.Low, on_machine=False)
    first = Bench(made, autonomy=Autonomy.Off)
    assert first.outcome is None
    define(made)
    first.stop()
    second = Bench(made, autonomy=Autonomy.Full)
    assert second.outcome == 'ended'
    assert first.run.controls.level('/A/B') == Autonomy.Off
