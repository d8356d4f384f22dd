# SPDX-License-Identifier: BSD-3-Clause
"""``bt_tool check`` of trees with ``ReachGoal``: the mission, its skills, and whether there may be a way."""

from __future__ import annotations

import functools
from pathlib import Path

import pytest

from flexbt_core.behavior_tree.engine.registry import NodeRegistry
from flexbt_server.node_types import node_registry
from flexbt_testing.behavior_trees.bt_tool import document, tool
from flexbt_tools.tree_checks.check import check_trees
from flexbt_tools.tree_checks.diagnostics import MISSION

SKILLS = """
objects: {kitchen: room, office: room, cup: thing, shelf: thing}
predicates:
  robot_at: {parameters: {where: room}, exclusive: where, sensor: {blackboard: robot == '$where'}}
  shut: {sensor: {blackboard: door == 'shut'}}
  joined: {parameters: {from: room, to: room}}
  held: {parameters: {what: thing}}
  light: {parameters: {what: thing}}
skills:
  GoTo:
    parameters: {from: room, to: room}
    preconditions: [robot_at(from), 'joined(from, to)', not shut]
    outcomes: {SUCCESS: [robot_at(to)]}
  Grasp:
    parameters: {what: thing}
    preconditions: [robot_at(kitchen), light(what)]
    outcomes: {SUCCESS: [held(what)]}
"""
CUP = """skills: [skills.yaml]
start: [light(cup), 'joined(office, kitchen)']
goal: held(cup)
"""


@functools.cache
def registry() -> NodeRegistry:
    return node_registry(lambda source, error: None)


def found(directory: Path, ports: str) -> list[str]:
    """Return the findings of the rule, as ``file:line message``."""
    tree = directory / 'tree.xml'
    tree.write_text(document(f'Main: <ReachGoal {ports}/>'))
    findings = check_trees([str(tree)], registry())
    return [
        f'{Path(one.place.file).name}:{one.place.line} {one.place.message}' for one in findings if one.rule is MISSION
    ]


@pytest.mark.parametrize(
    ('wrong', 'right', 'goal', 'message'),
    [
        ('', '', '', None),
        ('', '', '{asked}', None),
        # Where the robot is, and whether the door is shut, is measured: neither is a reason against the goal.
        ('', '', 'robot_at(kitchen) &amp; !shut | shut', None),
        ("'joined(office, kitchen)'", '', 'robot_at(office)', None),
        # What is measured, and what others may do, can be the same, or be written differently.
        ('goal:', "disturbances: [['not  shut'], [shut], [shut]]\ngoal:", '', None),
        ('', '', 'held(shelf)', "tree.xml:2 the goal 'held(shelf)' of DIR/cup.yaml cannot be reached: held(shelf) doe"),
        ('', '', 'held(mug)', "tree.xml:2 goal: held(mug): 'mug' is not an object"),
        ('', '', 'held(cup', "tree.xml:2 goal 'held(cup', character 5"),
        ('light(cup), ', '', '', "tree.xml:2 the goal 'held(cup)' of DIR/cup.yaml cannot be reached: held(cup) does"),
        ('held(cup)', 'held(cup) & hold(cup)', '', "cup.yaml:3 goal: hold(cup): there is no predicate 'hold'"),
        ('light(cup)', 'robot_at(office), robot_at(kitchen)', '', 'cup.yaml:2 start: robot_at(office) and robot_at(k'),
        ('goal: held(cup)', '', '', 'tree.xml:2 DIR/cup.yaml names no goal'),
        ('goal: held(cup)', '', '{asked}', None),
        ('skills.yaml', 'other.yaml', '', "cup.yaml:1 skills: there is no file 'DIR/other.yaml'"),
        ('goal:', 'goals:', '', "cup.yaml:3 a mission cannot have 'goals'; did you mean 'goal'?"),
        ('goal:', 'robots: {red: [GoTo], blue: [Grasp]}\ngoal:', '', 'tree.xml:2 DIR/cup.yaml is for several robots'),
    ],
)
def test_missions_are_read_and_weighed(tmp_path: Path, wrong: str, right: str, goal: str, message: str | None) -> None:
    (tmp_path / 'skills.yaml').write_text(SKILLS)
    (tmp_path / 'cup.yaml').write_text(CUP.replace(wrong, right, 1))
    port = f' goal="{goal}"' if goal else ''
    findings = found(tmp_path, f'mission="{tmp_path}/cup.yaml"{port}')
    wanted = [] if message is None else [message.replace('DIR', str(tmp_path))]
    assert len(findings) == len(wanted) and all(map(str.startswith, findings, wanted)), findings
    if 'no action brings' in ''.join(findings):
        assert findings[0].endswith(
            '(Grasp would, but needs light(what), which nothing changes: is it missing at the start?)'
        )


def test_a_skill_may_have_the_name_of_a_predicate(tmp_path: Path) -> None:
    skill = '  robot_at: {parameters: {where: room}, outcomes: {SUCCESS: [robot_at(where)]}}\n'
    (tmp_path / 'skills.yaml').write_text(SKILLS + skill)
    (tmp_path / 'cup.yaml').write_text(CUP)
    assert found(tmp_path, f'mission="{tmp_path}/cup.yaml"') == []


def test_a_mission_that_is_not_there(tmp_path: Path) -> None:
    assert found(tmp_path, 'mission="{which}"') == []
    assert found(tmp_path, f'mission="{tmp_path}/no.yaml"') == [
        f'tree.xml:2 {tmp_path}/no.yaml: cannot be read: No such file or directory'
    ]
    assert 'no installed package' in found(tmp_path, 'mission="flexbt_none/missions/cup.yaml"')[0]


def test_a_leaf_of_the_same_name_that_has_other_ports_is_told_of(tmp_path: Path) -> None:
    skill = 'predicates: {held: {parameters: {what: thing}, sensor: {blackboard: held}}}\nskills:\n'
    skill += '  Wait: {parameters: {what: thing}, outcomes: {SUCCESS: [held(what)]}}\n'
    file = tmp_path / 'skills.yaml'
    file.write_text(skill)
    done = tool('skills', str(file))
    assert done.code == 0 and done.err.startswith(
        'note: skill Wait: the installed leaf of this name learns of no param'
    )
    file.write_text(skill.replace('Wait: {', "Wait: {arguments: {wait_duration: '{$what}'}, "))
    assert tool('skills', str(file)).err == ''
