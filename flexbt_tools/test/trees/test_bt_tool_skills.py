# SPDX-License-Identifier: BSD-3-Clause
"""``bt_tool skills``: what leaves declare, and what files add; wrong files are refused with their lines."""

from __future__ import annotations

import inspect
import json
from pathlib import Path

import pytest

from flexbt_core.behavior_tree.engine.leaf import SyncAction
from flexbt_core.behavior_tree.engine.registry import node_skill, node_skills
from flexbt_core.behavior_tree.model.status import NodeStatus
from flexbt_core.behavior_tree.nodes.builtin import builtin_registry
from flexbt_core.skills.literals import Predicate, SkillError, parse_literals
from flexbt_core.skills.skill import OutcomeClass, Skill
from flexbt_core.skills.yaml_files import capability_file, read_skills
from flexbt_server.node_types import node_registry
from flexbt_testing.behavior_trees.bt_tool import tool


def test_the_file_that_it_prints_is_one_of_manifests() -> None:
    printed = read_skills(tool('skills', '--yaml').out)
    known = node_skills(node_registry(lambda source, error: None), pytest.fail)
    assert printed.predicates == known.predicates
    assert printed.skills.keys() == known.skills.keys()
    assert printed.skills['FollowPath'].writes == ('error_code_id', 'error_msg', 'tracking_feedback')


def test_a_file_adds_to_what_is_known_and_is_checked_against_it(tmp_path: Path) -> None:
    file = tmp_path / 'mission.yaml'
    file.write_text('objects: {front: door}\npredicates:\n  open: {parameters: {door: door}}\nskills:\n'
                    '  Wait: {cost: 4, outcomes: {SUCCESS: [open(front)]}}\n')  # fmt: skip
    told = json.loads(tool('skills', str(file), '--skill', 'Wait', '--json').out)['Wait']
    assert told['outcomes'] == {'SUCCESS': {'class': 'completed', 'effects': ['open(front)']}, 'FAILURE': 'failed'}
    assert told['cost'] == 4.0
    assert 'SUCCESS: completed, then open(front)' in tool('skills', str(file), '--skill', 'Wait').out
    file.write_text(file.read_text().replace('SUCCESS', 'DONE'))
    refused = tool('skills', str(file))
    assert refused.code == 3
    assert f"{file}:5:1: skill Wait has no outcome 'DONE' (FAILURE, SUCCESS)" in refused.err
    assert tool('skills', str(tmp_path / 'none.yaml')).code == 3
    assert tool('skills', '--skill', 'Wate').code == 2


class _Grab(SyncAction):
    skill = Skill.of(resources=['arm'], outcomes={'SUCCESS': ['holding']}, predicates=[Predicate('holding')])

    def tick(self) -> NodeStatus:
        return NodeStatus.SUCCESS


class _GrabGently(_Grab):
    pass


def test_what_derives_from_a_leaf_has_its_skill() -> None:
    registry = builtin_registry()
    for id, leaf in {'Grab': _Grab, 'GrabGently': _GrabGently}.items():
        skill = node_skill(registry.register(id, leaf))
        assert skill is not None
        assert (skill.name, skill.resources, skill.duration) == (id, ('arm',), (0.0, 0.0))
        assert {name: one.kind for name, one in skill.outcomes.items()} == {
            'SUCCESS': OutcomeClass.COMPLETED,
            'FAILURE': OutcomeClass.FAILED,
        }
    assert node_skill(next(one for one in registry if one.id == 'Sequence')) is None


def test_what_a_file_names_and_is_not_there_is_told(tmp_path: Path) -> None:
    file = tmp_path / 'mission.yaml'
    file.write_text("""\
predicates:
  close: {parameters: {goal: pose}, sensor: {condition: GoalReachd, ports: {goal: $goal}}}
  free: {parameters: {pose: pose}, sensor: {condition: CheckPoseOccupancy, ports: {pos: $pose}}}
  open: {}
  charged: {parameters: {of: robot}, sensor: {blackboard: 'level_$of >'}}
  full: {parameters: {of: robot}, sensor: {blackboard: "level_$of > 0.9 && of != '$of'"}}
  mine: {sensor: {condition: Mine}}
skills:
  NavigateToPose: {arguments: {gaol: '{$goal}'}}
  Mine: {cost: 1}
""")
    found = tool('skills', str(file))
    assert found.code == 1
    assert found.err.splitlines() == [
        "warning: sensor of predicate close: there is no leaf 'GoalReachd'; did you mean 'GoalReached'?",
        "warning: sensor of predicate free: CheckPoseOccupancy has no port 'pos'; did you mean 'pose'?",
        'warning: predicate open has no sensor: it is only remembered, so no tree can test it',
        "warning: sensor of predicate charged: 'level_$of >' is not a script: a value is missing here: a number, a "
        'name or a text; found the end of the script (column 10 of the script [level_x >])',
        "warning: arguments of skill NavigateToPose: NavigateToPose has no port 'gaol'; did you mean 'goal'?",
    ]
    assert tool('skills').err == ''


def test_the_example_of_the_page_is_right(tmp_path: Path) -> None:
    page = Path(__file__).parents[3] / 'docs' / 'reference' / 'skills.md'
    file = tmp_path / 'mission.yaml'
    file.write_text(page.read_text(encoding='utf-8').partition('```yaml\n')[2].partition('```')[0])
    told = tool('skills', str(file), '--skill', 'NavigateToPose')
    assert (told.code, told.err) == (0, '')
    assert 'needs: at(from), from != to, charged' in told.out
    skills = read_skills(file.read_text())
    assert 'NavigateToPose_kitchen_office:' in capability_file(
        skills, parse_literals(['at(office)', 'charged']), 'errand'
    )
    with pytest.raises(SkillError, match='say what no skill changes, too: charged'):
        capability_file(skills, parse_literals(['at(office)']), 'errand')
    mission = tmp_path / 'errand.yaml'
    mission.write_text('skills: [mission.yaml]\nstart: [at(kitchen), charged]\ngoal: at(office)\n')
    tree = tmp_path / 'plan.xml'
    assert tool('plan', str(mission), '--output', str(tree)).code == 0
    checked = tool('check', str(tree), *(f'--input={key}' for key in ('kitchen', 'office', 'battery_level')))
    assert (checked.code, checked.out) == (0, '')  # it gives the leaf of Nav2 no ports that it does not have


def test_what_a_class_declares_wrongly_is_told_with_its_place_and_left_out() -> None:
    registry = builtin_registry()
    wrong = Skill.of(resources=['arm'], outcomes={'SUCCESS': ['holdin']})
    other = Skill.of(predicates=[Predicate('holding', {'what': 'cup'}, exclusive='who')])
    registry.register('Grab', _Grab)
    registry.register('GrabWrongly', type('GrabWrongly', (_Grab,), {'skill': wrong}))
    registry.register('Other', type('Other', (_GrabGently,), {'skill': other}))
    told: list[str] = []
    library = node_skills(registry, told.append)
    assert library.skills['GrabWrongly'].resources == ('arm',)
    assert library.skills['GrabWrongly'].outcomes['SUCCESS'].effects == ()
    assert [one.partition(': ')[2] for one in told] == [
        'skill of Other: the predicate holding is declared twice, and differently; declare it once',
        "skill of GrabWrongly: outcomes SUCCESS: holdin: there is no predicate 'holdin'; did you mean 'holding'?",
    ]
    told.clear()
    registry.register('Last', _WithUnknown)
    node_skills(registry, told.append)
    assert f'{__file__}:{inspect.getsourcelines(_WithUnknown)[1]}: skill of Last: preconditions: ' in told[-1]


class _WithUnknown(_Grab):
    skill = Skill.of(preconditions=['nothing_of_the_kind'])
