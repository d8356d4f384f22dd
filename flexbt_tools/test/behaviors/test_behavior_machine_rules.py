# SPDX-License-Identifier: BSD-3-Clause
"""What the check says of state machines, compared with what walks through them say."""

from __future__ import annotations

from collections.abc import Mapping

import pytest
from behavior_tool_support import Leaf, found
from hypothesis import given
from hypothesis import strategies as st

from flexbt_core.state_machine.authoring.machine import ConcurrencyContainer, OperatableStateMachine
from flexbt_core.state_machine.model.autonomy import Autonomy
from flexbt_core.state_machine.model.event_state import EventState
from flexbt_core.state_machine.model.userdata import MachineError

LABELS = ('A', 'B', 'C', 'D', 'E')
ENDS = ('done', 'failed')
OUTCOMES = ('one', 'two')

ways = st.dictionaries(st.sampled_from(OUTCOMES), st.sampled_from([*LABELS, *ENDS]), min_size=1)
machines = st.fixed_dictionaries({label: st.tuples(ways, st.booleans(), st.booleans()) for label in LABELS})
"""For each state: where its outcomes lead, whether it leaves at once, whether its outcomes require Low."""


def machine_of(drawn: Mapping[str, tuple[dict[str, str], bool, bool]]) -> OperatableStateMachine:
    machine = OperatableStateMachine(outcomes=ENDS)
    with machine:
        for label in LABELS:
            targets, is_instant, is_gated = drawn[label]
            autonomy = dict.fromkeys(targets, Autonomy.Low) if is_gated else {}
            OperatableStateMachine.add(label, Leaf(*targets, is_instant=is_instant), targets, autonomy)
    return machine


@given(machines)
def test_as_walks_tell(drawn: Mapping[str, tuple[dict[str, str], bool, bool]]) -> None:
    steps = {label: set(targets.values()) for label, (targets, _, _) in drawn.items()}
    walks = dict(steps)  # where walks of any length lead
    for _ in LABELS:
        walks = {label: reached.union(*(walks.get(one, ()) for one in reached)) for label, reached in walks.items()}
    if {'A'} | walks['A'] < {*LABELS}:
        return  # the engine refuses it
    try:
        rules = found(machine_of(drawn))
    except MachineError:
        assert not walks['A'] >= {*LABELS} - {'A'}
        return
    stuck = {label for label in LABELS if not walks[label] & {*ENDS}}
    if stuck == {*LABELS}:
        assert rules.count(('no-end', '/')) == 1
    else:
        assert {path for rule, path in rules if rule == 'no-end'} == {f'/{label}' for label in stuck}
        assert rules.count(('dead-outcome', '/')) == len({*ENDS} - walks['A'])
    instant = {label for label, (_, is_instant, is_gated) in drawn.items() if is_instant and not is_gated}
    loops = {label: steps[label] & instant for label in instant}
    for _ in LABELS:
        loops = {label: reached.union(*(loops[one] for one in reached)) for label, reached in loops.items()}
    circles = {
        frozenset(one for one in loops[start] if start in loops[one]) for start in loops if start in loops[start]
    }
    named = [path.removeprefix('/') for rule, path in rules if rule == 'endless-loop']
    assert len(named) == len(circles)
    assert all(any(label in circle for label in named) for circle in circles)


def test_a_loop_that_asks_the_operator_waits() -> None:
    machine = OperatableStateMachine(outcomes=['done'])
    with machine:
        OperatableStateMachine.add(
            'A', Leaf('again', 'out', is_instant=True), {'again': 'A', 'out': 'done'}, {'again': Autonomy.Low}
        )
    assert found(machine) == []


def test_machines_in_machines() -> None:
    inner = OperatableStateMachine(outcomes=['done', 'failed'])
    with inner:
        OperatableStateMachine.add('Spin', Leaf('go', is_instant=True), {'go': 'Spin'})
    outer = OperatableStateMachine(outcomes=['done'])
    with outer:
        levels = {'done': Autonomy.Full, 'failed': Autonomy.Full}  # that a failure always asks is no remark
        OperatableStateMachine.add('Inner', inner, {'done': 'done', 'failed': 'done'}, levels)
    assert sorted(found(outer)) == [('always-asks', '/Inner'), ('endless-loop', '/Inner/Spin'), ('no-end', '/Inner')]


def test_containers_end_by_their_conditions() -> None:
    both = ConcurrencyContainer(outcomes=['done', 'never'], conditions=[('done', [('Left', 'go'), ('Right', 'go')])])
    with both:
        for label in ('Left', 'Right'):
            OperatableStateMachine.add(label, Leaf('go', is_instant=True), {'go': 'done'})
    machine = OperatableStateMachine(outcomes=['done'])
    with machine:
        OperatableStateMachine.add('Both', both, {'done': 'done', 'never': 'done'})
    assert found(machine) == [('dead-outcome', '/Both')]


def test_what_several_write_at_a_time() -> None:
    both = ConcurrencyContainer(['done'], [], ['data'], [], [('done', [('Left', 'go'), ('Right', 'go')])])
    with both:
        for label in ('Left', 'Right'):
            writer = Leaf('go')
            writer.output_keys = ('data',)
            OperatableStateMachine.add(label, writer, {'go': 'done'})
    machine = OperatableStateMachine(outcomes=['done'])
    with machine:
        OperatableStateMachine.add('Both', both, {'done': 'done'})
    assert found(machine) == [('write-race', '/Both')]


def test_what_only_some_ways_write() -> None:
    machine = OperatableStateMachine(outcomes=['done'])
    writer, reader = Leaf('next'), Leaf('out')
    writer.output_keys, reader.input_keys = ('data',), ('data',)
    with machine:
        OperatableStateMachine.add('Ask', Leaf('yes', 'no'), {'yes': 'Write', 'no': 'Read'})
        OperatableStateMachine.add('Write', writer, {'next': 'Read'})
        OperatableStateMachine.add('Read', reader, {'out': 'done'})
    assert found(machine) == [('unsure-read', '/Read')]


def way(label: str, state: EventState | OperatableStateMachine, **ways: str) -> None:
    OperatableStateMachine.add(label, state, ways)


@pytest.mark.parametrize(
    ('ways', 'rules'),
    [
        ({'done': 'Next', 'failed': 'Recover'}, []),
        ({'done': 'Recover', 'failed': 'Next'}, [('crossed-ways', '/Go')]),
        ({'done': 'failed', 'failed': 'finished'}, [('crossed-ways', '/Go')]),
        ({'done': 'Recover', 'failed': 'finished'}, [('crossed-ways', '/Go')]),
        ({'done': 'failed', 'failed': 'failed'}, []),  # a cleanup before the mission is given up
        ({'done': 'failed', 'failed': 'Next'}, []),
        ({'done': 'finished', 'failed': 'finished'}, []),  # whether it succeeds does not matter
    ],
)
def test_success_that_leads_where_failure_should(ways: dict[str, str], rules: list[tuple[str, str]]) -> None:
    machine = OperatableStateMachine(outcomes=['finished', 'failed'])
    with machine:
        way('First', Leaf('one', 'two', 'three', 'four'), one='Go', two='Recover', three='Next', four='failed')
        way('Go', Leaf('done', 'failed'), **ways)
        way('Recover', Leaf('done', 'failed'), done='Go', failed='failed')
        way('Next', Leaf('done', 'failed'), done='finished', failed='failed')
    assert found(machine) == rules


@pytest.mark.parametrize(
    ('conditions', 'rules'),
    [
        ([('finished', [('Drive', 'done')]), ('failed', [('Drive', 'failed')]), ('failed', [('Watch', 'failed')])], []),
        ([('finished', [('Drive', 'done')]), ('failed', [('Drive', 'failed')])], [('unheard-failure', '/Both/Watch')]),
        ([('finished', [('Drive', 'done'), ('Watch', 'done')]), ('failed', [('Drive', 'failed')]),
          ('failed', [('Drive', 'done'), ('Watch', 'failed')])], []),
    ],
    ids=['all', 'without', 'together'],
)  # fmt: skip
def test_a_failure_in_a_container_that_nobody_hears(
    conditions: list[tuple[str, list[tuple[str, str]]]], rules: list[tuple[str, str]]
) -> None:
    both = ConcurrencyContainer(['finished', 'failed'], conditions=conditions)
    with both:
        way('Drive', Leaf('done', 'failed'))
        way('Watch', Leaf('done', 'failed'))
    machine = OperatableStateMachine(outcomes=['finished', 'failed'])
    with machine:
        way('Both', both, finished='finished', failed='failed')
    assert found(machine) == rules


class Writer(EventState):
    def __init__(self) -> None:
        super().__init__(['done'], output_keys=['pose'])


class Reader(EventState):
    def __init__(self) -> None:
        super().__init__(['done'], input_keys=['pose'])


@pytest.mark.parametrize(
    ('output_keys', 'reads_inside', 'rules'),
    [
        (['pose'], False, []),
        ([], False, [('lost-write', '/Look/Write')]),
        ([], True, []),  # it is for the machine itself
    ],
    ids=['handed out', 'lost', 'own'],
)
def test_a_value_that_does_not_get_out_of_its_machine(
    output_keys: list[str], reads_inside: bool, rules: list[tuple[str, str]]
) -> None:
    inner = OperatableStateMachine(outcomes=['done'], output_keys=output_keys)
    with inner:
        way('Write', Writer(), done='Use' if reads_inside else 'done')
        if reads_inside:
            way('Use', Reader(), done='done')
    machine = OperatableStateMachine(outcomes=['done'])
    machine.userdata['pose'] = 'home'
    with machine:
        way('Look', inner, done='Go')
        way('Go', Reader(), done='done')
    assert found(machine) == rules
