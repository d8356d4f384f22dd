# SPDX-License-Identifier: BSD-3-Clause
"""What the check says of states and their skills: actuators that two of them need, outcomes that mean nothing."""

from __future__ import annotations

from pathlib import Path

import pytest
from behavior_tool_support import Leaf, found

from flexbt_core.skills.skill import Outcome, Skill
from flexbt_core.state_machine.authoring.machine import ConcurrencyContainer, OperatableStateMachine, PriorityContainer
from flexbt_core.state_machine.model.autonomy import Autonomy
from flexbt_core.state_machine.model.event_state import EventState
from flexbt_states import BtExecuteState, BtLoaderState
from flexbt_testing.behavior_trees.bt_tool import behavior_tool as tool


def skilled(skill: Skill, *outcomes: str) -> EventState:
    state = Leaf(*(outcomes or ('done',)))
    state.skill = skill
    return state


def at_once(*states: EventState | OperatableStateMachine) -> OperatableStateMachine:
    """States that run at the same time, after one that loads a tree that drives."""
    ends = [('done', [('S0', outcome)]) for outcome in states[0].outcomes]
    both = ConcurrencyContainer(outcomes=['done'], conditions=ends)
    with both:
        for index, state in enumerate(states):
            ConcurrencyContainer.add(f'S{index}', state)
    machine = OperatableStateMachine(outcomes=['done', 'failed'])
    drive = '<root BTCPP_format="4"><BehaviorTree ID="Drive"><Spin/></BehaviorTree></root>'
    with machine:
        OperatableStateMachine.add('Load', BtLoaderState(xml=drive), {'done': 'Both', 'failed': 'failed'})
        OperatableStateMachine.add('Both', both, {'done': 'done'})
    return machine


def inside(container: type[OperatableStateMachine], state: EventState) -> OperatableStateMachine:
    made = container(outcomes=['done'])
    with made:
        OperatableStateMachine.add('In', state, dict.fromkeys(state.outcomes, 'done'))
    return made


ARM = Skill.of(resources=['arm'])
BASE = Skill.of(resources=['base'])


@pytest.mark.parametrize(
    ('states', 'clashes'),
    [
        pytest.param([skilled(ARM), skilled(ARM)], 1, id='two of one arm'),
        pytest.param([skilled(ARM), skilled(BASE)], 0, id='arm and base'),
        pytest.param([skilled(ARM), skilled(ARM), inside(OperatableStateMachine, skilled(ARM))], 3, id='three'),
        pytest.param([skilled(ARM), skilled(ARM.lasting(0.0, 0.0))], 0, id='one takes no time'),
        pytest.param([skilled(ARM), inside(PriorityContainer, skilled(ARM))], 0, id='priority pauses the others'),
        pytest.param([BtExecuteState(bt_file='Drive'), skilled(BASE)], 1, id='a tree and a state'),
        pytest.param([BtExecuteState(bt_file='Drive'), skilled(ARM)], 0, id='a tree, and a state of the arm'),
    ],
)
def test_who_runs_at_the_same_time_needs_actuators_of_his_own(states: list[EventState], clashes: int) -> None:
    assert found(at_once(*states)) == [('shared-resource', '/Both')] * clashes


def test_a_skill_says_what_the_outcomes_of_its_state_mean() -> None:
    speaking = {'done': Outcome.of('completed', 'ready')}
    for skill, outcomes, findings in [
        (Skill.of(outcomes=speaking), ['done', 'failed'], []),
        (Skill.of(outcomes=speaking), ['done', 'lost'], ['skill']),
        (Skill.of(outcomes={**speaking, 'lost': 'failed'}), ['done', 'lost'], []),
        (Skill.of(outcomes={**speaking, 'lots': 'failed'}), ['done', 'failed'], ['skill']),
        (Skill(), ['done', 'lost'], []),  # nobody has said anything of it
    ]:
        state = skilled(skill, *outcomes)
        machine = OperatableStateMachine(outcomes=['done'])
        with machine:
            OperatableStateMachine.add('S', state, dict.fromkeys(outcomes, 'done'))
        assert [rule for rule, _ in found(machine)] == findings, (skill, outcomes)


GRAB = Skill.of(preconditions=['not holding'], outcomes={'done': Outcome.of('completed', 'holding', autonomy='high')})
PUT = Skill.of(preconditions=['holding'], outcomes={'done': ['not holding']})
LOOK = Skill.of(outcomes={'true': Outcome.of('answered', 'holding'), 'false': Outcome.of('answered', 'not holding')})


@pytest.mark.parametrize(
    ('ways', 'level', 'findings'),
    [
        pytest.param({'Grab.done': 'Put', 'Put.done': 'Grab'}, Autonomy.High, [], id='as the skills say'),
        pytest.param({'Grab.done': 'Grab'}, Autonomy.High, [('skill', '/Grab')], id='grabbed twice'),
        pytest.param({'Put.done': 'Put'}, Autonomy.High, [('skill', '/Put')], id='put down twice'),
        pytest.param({'Look.true': 'Put', 'Look.false': 'Grab'}, Autonomy.High, [], id='by what was seen'),
        pytest.param({'Look.true': 'Grab', 'Look.false': 'Put'}, Autonomy.High, [('skill', '/Grab'), ('skill', '/Put')],
                     id='the wrong way round'),
        pytest.param({'Grab.done': 'Put'}, Autonomy.Low, [('skill', '/Grab')], id='too little autonomy'),
        pytest.param({'Grab.done': 'Put'}, None, [('skill', '/Grab')], id='no autonomy'),
    ],
)  # fmt: skip
def test_transitions_that_contradict_what_is_known(
    ways: dict[str, str], level: int | None, findings: list[tuple[str, str]]
) -> None:
    states = {'Grab': (GRAB, ['done']), 'Put': (PUT, ['done']), 'Look': (LOOK, ['true', 'false'])}
    machine = OperatableStateMachine(outcomes=['done'])
    used = {way.partition('.')[0] for way in ways} | set(ways.values())
    with machine:
        OperatableStateMachine.add('Start', Leaf(*used, 'out'), {**{one: one for one in used}, 'out': 'done'})
        for label in used:
            skill, outcomes = states[label]
            targets = {outcome: ways.get(f'{label}.{outcome}', 'done') for outcome in outcomes}
            autonomy = {'done': level} if label == 'Grab' and level is not None else {}
            OperatableStateMachine.add(label, skilled(skill, *outcomes), targets, autonomy=autonomy)
    told = [one for one in found(machine) if one[0] != 'no-end']
    assert sorted(told) == findings


def test_files_of_skills_are_taken(tmp_path: Path) -> None:
    file = tmp_path / 'skills.yaml'
    file.write_text('skills: {LogState: {resources: [speaker]}}')
    assert tool('check', '--skills', str(file)).code == 0
    file.write_text('skills: {LogState: {resource: [speaker]}}')
    refused = tool('check', '--skills', str(file))
    assert (refused.code, refused.out) == (3, '')
    assert f"{file}:1:1: skill LogState cannot have 'resource'; did you mean 'resources'?" in refused.err
