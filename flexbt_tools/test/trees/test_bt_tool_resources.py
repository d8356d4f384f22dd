# SPDX-License-Identifier: BSD-3-Clause
"""What ``check`` says of children that need the same actuator, against what the engine runs at once."""

from __future__ import annotations

from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from flexbt_core.behavior_tree.engine.leaf import StatefulAction, SyncAction
from flexbt_core.behavior_tree.engine.node import NodeConfig
from flexbt_core.behavior_tree.engine.parents import ControlNode
from flexbt_core.behavior_tree.engine.tree import Tree
from flexbt_core.behavior_tree.model.definition import TreeLibrary
from flexbt_core.behavior_tree.model.errors import NodeExecutionError, RegistrationError
from flexbt_core.behavior_tree.model.status import NodeStatus
from flexbt_core.behavior_tree.nodes.builtin import builtin_registry
from flexbt_core.behavior_tree.xml.reader import load_xml
from flexbt_core.clock.clock import ManualClock
from flexbt_core.skills.skill import Skill
from flexbt_core.skills.yaml_files import read_skills
from flexbt_server.node_types import node_registry
from flexbt_testing.behavior_trees.bt_tool import STOCK_TREES, document
from flexbt_testing.behavior_trees.steps import LETTERS
from flexbt_tools.tree_checks.check import check_trees


class Use(StatefulAction):
    """Needs the arm while it runs; gives what the services say, call by call."""

    skill = Skill.of(resources=['arm'])

    def __init__(self, config: NodeConfig) -> None:
        super().__init__(config)
        self.script = iter(self.services.get(config.name, ''))

    def on_start(self) -> NodeStatus:
        return LETTERS[next(self.script, 'S')]

    on_running = on_start

    def on_halted(self) -> None:
        pass


class Look(SyncAction):
    """Uses the arm, and is done at once."""

    skill = Skill.of(resources=['arm'])

    def tick(self) -> NodeStatus:
        return NodeStatus.SUCCESS


REGISTRY = node_registry(lambda source, error: None)
REGISTRY.register_classes((Use, Look))
CONTROLS = {
    manifest.id: manifest
    for manifest in REGISTRY
    if issubclass(manifest.node_class, ControlNode) and manifest.id != 'ManualSelector'
}


def clashes(text: str, tmp_path: Path, skills: str = 'skills: {}') -> list[str]:
    file = tmp_path / 'trees.xml'
    file.write_text(text)
    found = check_trees([str(file)], REGISTRY, skills=read_skills(skills))
    return [f'{one.place.line} {one.place.message}' for one in found if one.rule.name == 'shared-resource']


@pytest.mark.parametrize('id', CONTROLS)
@settings(max_examples=25)
@given(scripts=st.lists(st.text('RSF', max_size=6), min_size=2, max_size=3))
def test_only_what_says_so_runs_several_children_at_once(id: str, scripts: list[str]) -> None:
    manifest = CONTROLS[id]
    least, _ = manifest.node_class.tickable_with or (1, None)
    scripts = (scripts * 8)[: max(least, len(scripts))]
    ports = ''.join(f' {name}="{_value(name)}"' for name, port in manifest.ports.items() if port.required)
    children = ''.join(f'<Use name="{index}"/>' for index in range(len(scripts)))
    if manifest.children[1] is not None and not manifest.children[0] <= len(scripts) <= manifest.children[1]:
        scripts = (scripts * 8)[: manifest.children[1]]
        children = ''.join(f'<Use name="{index}"/>' for index in range(len(scripts)))
    text = document(f'Main: <{id}{ports}>{children}</{id}>')
    library = TreeLibrary([load_xml(text, 'file', REGISTRY)])
    services = {str(index): script for index, script in enumerate(scripts)}
    tree = Tree(library, 'Main', services=services, clock=ManualClock())
    tree.blackboard.set('current_child_idx', 0)
    uses = [node for node in tree.nodes if isinstance(node, Use)]
    for _ in range(8):
        try:
            tree.tick_once()
        except NodeExecutionError:
            break
        at_once = sum(node.status is NodeStatus.RUNNING for node in uses)
        assert at_once <= 1 or manifest.node_class.runs_several


def _value(port: str) -> str:
    return '{current_child_idx}' if port == 'current_child_idx' else '1'


@pytest.mark.parametrize('id', ['Parallel', 'ParallelAll', 'PipelineSequence', 'NonblockingSequence'])
def test_two_children_that_need_one_arm(id: str, tmp_path: Path) -> None:
    sub = 'Sub: <Sequence><Look/><Use/></Sequence>'
    message = f"5 <Use> and <Use 'b'> need [arm] for themselves, and may run at once in <{id}>"
    assert clashes(document(f'Main: <{id}>\n<Look/>\n<SubTree ID="Sub"/>\n<Use name="b"/></{id}>', sub), tmp_path) == [
        message
    ]
    assert clashes(document(f'Main: <Sequence><Use/><{id}><Look/><Use/></{id}><Use/></Sequence>'), tmp_path) == []
    without = 'skills: {Use: {resources: []}}'
    assert clashes(document(f'Main: <{id}><Use/><Use/></{id}>'), tmp_path, without) == []


@pytest.mark.skipif(not STOCK_TREES, reason='Nav2 is not at hand')
def test_in_no_tree_of_nav2_two_drive_at_once() -> None:
    found = [one for file in STOCK_TREES for one in check_trees([str(file)], REGISTRY)]
    assert [str(one) for one in found if one.rule.name == 'shared-resource'] == []


def test_a_class_with_a_wrong_skill_cannot_be_registered() -> None:
    for skill, message in [
        (Skill.of(outcomes={'done': 'completed'}), "'done' is not an outcome of a leaf; it ends by SUCCESS or FAILURE"),
        (Skill.of(cost=-1.0), 'cost: -1.0 has to be a number from 0 on'),
    ]:
        wrong = type('Wrong', (Look,), {'skill': skill})
        with pytest.raises(RegistrationError) as error:
            builtin_registry().register('Wrong', wrong)
        assert str(error.value) == f'node ID [Wrong], skill: {message}'
