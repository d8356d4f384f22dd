# SPDX-License-Identifier: BSD-3-Clause
"""Skills as capabilities: the machine that is synthesized of them does what the manifests say."""

from __future__ import annotations

from pathlib import Path

import pytest

from flexbt_core.skills.literals import Literal, SkillError, parse_literal
from flexbt_core.skills.yaml_files import capability_file, read_skills
from flexbt_formal.synthesis.capabilities import StateInterface, read_capabilities
from flexbt_formal.synthesis.request_files import MachineRequest
from flexbt_formal.synthesis.synthesis import synthesize
from flexbt_formal.synthesis.translation import translated
from flexbt_testing.behavior_trees.bt_tool import behavior_tool as tool

TEXT = """\
objects: {kitchen: place, office: place, mug: cup}
predicates:
  at: {parameters: {where: place}, exclusive: where}
  in_room: {parameters: {what: cup, where: place}, exclusive: where}
  holding: {parameters: {what: cup}}
  road: {parameters: {from: place, to: place}}
skills:
  Drive:
    parameters: {from: place, to: place}
    preconditions: [at(from), 'road(from, to)']
    outcomes:
      done: {class: completed, effects: [at(to)], autonomy: high}
      failed: failed
    arguments: {goal: $to}
  Grab:
    parameters: {what: cup, where: place}
    preconditions: [at(where), 'in_room(what, where)', not holding(what)]
    outcomes:
      done: [holding(what), 'not in_room(what, where)']
      failed: failed
      timeout: timed_out
  Put:
    parameters: {what: cup, where: place}
    preconditions: [at(where), holding(what)]
    outcomes: {done: ['in_room(what, where)', not holding(what)], failed: failed}
  Look: {outcomes: {'true': answered, 'false': answered}}
"""
START = ['at(office)', 'in_room(mug, kitchen)', 'road(office, kitchen)', 'road(kitchen, office)']


def literals(*texts: str) -> list[Literal]:
    return [parse_literal(one) for one in texts]


def interface(name: str, parameters: object) -> StateInterface:
    skill = read_skills(TEXT).skills[name]
    return StateInterface(tuple(skill.outcomes), (), ())


def test_a_machine_of_skills_reaches_its_goal() -> None:
    text = capability_file(read_skills(TEXT), literals(*START), 'errand')
    capabilities = read_capabilities(text, 'errand.yaml')
    assert list(capabilities.capabilities) == [
        'Drive_kitchen_office',
        'Drive_office_kitchen',
        'Grab_mug_kitchen',
        'Grab_mug_office',
        'Put_mug_kitchen',
        'Put_mug_office',
    ]
    assert capabilities.capabilities['Drive_office_kitchen'].autonomy == {'done': 2}
    assert capabilities.memory['at_office'] and not capabilities.memory['at_kitchen']
    request = MachineRequest(goals=('in_room_mug_office',), outcomes=('finished', 'failed'))
    result = synthesize(translated(capabilities, interface, request))
    machine = result.machine
    assert machine is not None
    # The one way, when all completes, by what the manifests say.
    way, label = [], machine.initial
    while label in machine.states:
        state = machine.states[label]
        way += [part.capability for part in state.parts]
        label = state.transitions['done']
    assert way == ['Drive_office_kitchen', 'Grab_mug_kitchen', 'Drive_kitchen_office', 'Put_mug_office']
    assert label == 'finished'


@pytest.mark.parametrize(
    ('right', 'wrong', 'message'),
    [
        (
            'timeout: timed_out',
            'timeout: answered',
            "skill Grab: outcome 'timeout' is an answer; a capability",
        ),
        ('timeout: timed_out', 'lost: {}', "skill Grab: outcome 'lost' has no class; a capability completes or fails"),
        ('timeout: timed_out', 'timeout: [holding(what)]', 'outcomes that are failure have other effects than'),
        ('not holding(what)], failed: failed}', 'not holding(what)], failed: completed}', "'failed' is completed, and"),
        ('mug: cup', 'mug-1: cup, mug_1: cup', 'would both be called'),
    ],
)
def test_what_has_no_form_there_is_told(right: str, wrong: str, message: str) -> None:
    assert right in TEXT
    with pytest.raises(SkillError) as error:
        capability_file(read_skills(TEXT.replace(right, wrong)), literals(*START[:1], *START[2:]), 'errand')
    assert message in str(error.value)


def test_skills_of_a_file_as_capabilities(tmp_path: Path) -> None:
    file = tmp_path / 'skills.yaml'
    file.write_text(
        'objects: {hall: place, dock: place}\n'
        'predicates: {at: {parameters: {where: place}, exclusive: where}}\n'
        'skills: {Drive: {parameters: {to: place}, outcomes: {done: [at(to)], failed: failed}}}\n'
    )
    assert 'done: completed, then at(to)' in tool('skills', str(file)).out
    made = read_capabilities(tool('skills', str(file), '--capabilities', 'm', '--start', 'at(hall)').out, 'm.yaml')
    assert list(made.capabilities) == ['Drive_hall', 'Drive_dock']
    assert made.memory == {'at_hall': True, 'at_dock': False}
    refused = tool('skills', str(file), '--capabilities', 'm', '--start', 'at hall')
    assert (refused.code, refused.out) == (2, '')
    assert "'at hall' is not a literal" in refused.err
