# SPDX-License-Identifier: BSD-3-Clause
"""Node types of YAML files: what their trees send, and what is refused with file and line."""

from __future__ import annotations

import contextlib
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from nav2_msgs.action import DockRobot

from flexbt_common import names
from flexbt_common.values.entries import from_entry
from flexbt_core import load_xml
from flexbt_core.behavior_tree.engine.registry import NodeRegistry, node_skill
from flexbt_msgs.action import BtExecute
from flexbt_server.node_manifests import ManifestError, read_manifest
from flexbt_server.node_types import node_registry
from flexbt_testing.nodes.server_world import ServerWorld, open_server_world

DOCK = """
nodes:
  DockAt:
    action: nav2_msgs/action/DockRobot
    name: dock_robot
    description: Docks the robot at a station.
    fields:
      goal.use_dock_id: true
      goal.dock_id: '{station}'
      goal.max_staging_time: '${patience * 2}'
      result.num_retries: '{retries}'
    ports:
      station: {description: name of the station}
      patience: {type: float64, default: 30.0}
    success: result.success
    skill: {resources: [base]}
  Lamp:
    service: std_srvs/srv/SetBool
    name: lamp
    fields: {request.data: '{on}'}
    ports: {on: {default: true}}
    server_timeout: 10
"""
PACKAGE = 'flexbt_test_nodes'


@pytest.fixture(scope='module')
def world(tmp_path_factory: pytest.TempPathFactory) -> Iterator[ServerWorld]:
    """Return a server in whose ament index a package has a manifest."""
    prefix = tmp_path_factory.mktemp('prefix')
    index = prefix / 'share' / 'ament_index' / 'resource_index'
    for resource, text in (('packages', ''), ('flexbt_nodes', 'nodes.yaml\n')):
        (index / resource).mkdir(parents=True)
        (index / resource / PACKAGE).write_text(text)
    (prefix / 'share' / PACKAGE).mkdir()
    (prefix / 'share' / PACKAGE / 'nodes.yaml').write_text(DOCK)
    with contextlib.ExitStack() as stack:
        with pytest.MonkeyPatch.context() as patch:
            patch.setenv('AMENT_PREFIX_PATH', str(prefix), prepend=':')
            opened = stack.enter_context(open_server_world(tick_rate=50.0))
        opened.navigation.serve({names.DOCK_ROBOT: DockRobot})
        yield opened


def run(world: ServerWorld, body: str, blackboard: str, **fields: Any) -> Any:
    world.client.load_tree(body)
    return world.client.execute(blackboard=blackboard, **fields).result


def test_a_node_with_a_manifest_sends_what_it_says(world: ServerWorld) -> None:
    dock = world.navigation.actions[names.DOCK_ROBOT]
    dock.forget()
    world.navigation.hold.add(names.DOCK_ROBOT)
    world.client.load_tree('<DockAt station="{place}" retries="{tries}"/>')
    goal = world.client.execute(blackboard='dock', inputs={'place': 'kitchen', 'patience': 1.0})
    dock.end(0, result=DockRobot.Result(success=True, num_retries=2))
    assert goal.result.code == BtExecute.Result.SUCCESS, goal.result.message
    (sent,) = dock.goals
    assert (sent.use_dock_id, sent.dock_id, sent.max_staging_time) == (True, 'kitchen', 60.0)
    assert from_entry(world.client.get('tries', blackboard='dock').entries[0]) == 2


def test_the_condition_of_a_manifest_decides(world: ServerWorld) -> None:
    dock = world.navigation.actions[names.DOCK_ROBOT]
    dock.forget()
    world.navigation.hold.add(names.DOCK_ROBOT)
    world.client.load_tree('<DockAt station="hall" patience="5"/>')
    goal = world.client.execute(blackboard='judged')
    dock.end(0, result=DockRobot.Result(success=False))
    assert goal.result.code == BtExecute.Result.FAILURE
    assert 'not true: result.success (result.success = False)' in goal.result.message


def test_a_manifest_gives_defaults_and_names_may_be_overridden(world: ServerWorld) -> None:
    result = run(world, '<Lamp service_name="other_lamp"/>', 'lamp')
    assert 'other_lamp' in result.message
    result = (
        run(world, '<DockAt patience="5"/>', 'missing')
        if False
        else world.client.load(xml='<root BTCPP_format="4"><BehaviorTree ID="A"><DockAt/></BehaviorTree></root>')
    )
    assert 'port [station] of type std::string of [DockAt] is missing' in result.message


def test_tools_know_nodes_with_manifests() -> None:
    nodes = read_manifest(DOCK, 'nodes.yaml')
    manifest = NodeRegistry().register('DockAt', nodes['DockAt'])
    assert manifest.documentation == 'Docks the robot at a station.'
    skill = node_skill(manifest)
    assert skill is not None
    assert skill.resources == ('base',)
    assert {'station', 'patience'} <= set(skill.reads)


@pytest.mark.parametrize(
    ('facts', 'is_required'), [('{optional: false}', True), ('{optional: true}', False), ('{}', True)]
)
def test_a_port_is_optional_only_if_the_manifest_says_so(facts: str, is_required: bool) -> None:
    nodes = read_manifest(DOCK.replace('{description: name of the station}', facts), 'nodes.yaml')
    assert nodes['DockAt'].ports['station'].required is is_required


@pytest.mark.parametrize(('change', 'to', 'problem'), [
    ('DockRobot', 'DockRobo', "nodes.yaml:4: node DockAt: type 'nav2_msgs/action/DockRobo': package 'nav2_msgs' has"),
    ('goal.dock_id', 'goal.dock_idd', "nodes.yaml:9: node DockAt: [goal.dock_idd]: DockRobot_Goal has no field"),
    ('goal.dock_id', 'gaol.dock_id', 'nodes.yaml:9: node DockAt: [gaol.dock_id] begins with none of goal'),
    ('use_dock_id: true', 'use_dock_id: 5', 'nodes.yaml:8: node DockAt: [goal.use_dock_id]: field goal.use_dock_id'),
    ("'{retries}'", '5', 'nodes.yaml:11: node DockAt: [result.num_retries]: an output needs a port'),
    ('success: result.success', 'success: result.succes', "nodes.yaml:15: node DockAt: success: can't convert"),
    ('success: result.success', 'success: result.success = true', 'assigns nothing; write == to compare'),
    ('      station:', '      staton:', 'nodes.yaml:13: node DockAt: no field has the port staton; did you mean'),
    ('patience: {type: float64', 'patience: {type: float65', "nodes.yaml:14: node DockAt, port patience: 'float65'"),
    ('name: dock_robot', 'nam: dock_robot', "nodes.yaml:5: node DockAt cannot have 'nam'; did you mean 'name'?"),
    ('resources: [base]', 'resource: [base]', "cannot have 'resource'; did you mean 'resources'?"),
    ('action: nav2_msgs', 'publish: nav2_msgs', "nodes.yaml:4: node DockAt: type 'nav2_msgs/action/DockRobot': "),
    ("'{retries}'", "'{error_msg}'", 'nodes.yaml:11: node DockAt: it has a port error_msg anyway; use another name'),
    ('description: name of', 'optional: name of', 'nodes.yaml:13: optional of the port station of DockAt has to be'),
    ('${patience * 2}', '${patience *}', 'nodes.yaml:10: node DockAt: [goal.max_staging_time]: '),
])  # fmt: skip
def test_mistakes_are_found_with_their_lines(change: str, to: str, problem: str) -> None:
    assert change in DOCK
    with pytest.raises(ManifestError) as raised:
        read_manifest(DOCK.replace(change, to, 1), 'nodes.yaml')
    assert problem in str(raised.value)


def test_a_broken_manifest_does_not_keep_other_nodes_away(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    index = tmp_path / 'share' / 'ament_index' / 'resource_index'
    for resource, text in (('packages', ''), ('flexbt_nodes', 'no.yaml bad.yaml')):
        (index / resource).mkdir(parents=True)
        (index / resource / PACKAGE).write_text(text)
    (tmp_path / 'share' / PACKAGE).mkdir()
    (tmp_path / 'share' / PACKAGE / 'bad.yaml').write_text('nodes: [')
    (index / 'flexbt_nodes' / 'a_ghost').write_text('left.yaml')
    monkeypatch.setenv('AMENT_PREFIX_PATH', str(tmp_path), prepend=':')
    broken: list[str] = []
    registry = node_registry(lambda source, error: broken.append(f'{source}: {error}'))
    assert 'CallAction' in registry
    parts = ("package 'a_ghost' not found", 'no.yaml', 'bad.yaml:1: no YAML')
    assert [part in text for part, text in zip(parts, broken, strict=True)] == [True] * 3


def test_the_examples_of_the_page_load() -> None:
    page = (Path(__file__).parents[3] / 'docs' / 'how_to' / 'no_code.md').read_text(encoding='utf-8')
    blocks = dict.fromkeys(re.findall(r'```(xml|yaml)\n(.*?)```', page, re.DOTALL))
    registry = node_registry(lambda source, error: None)
    for kind, text in blocks:
        if kind == 'yaml' and text.startswith('nodes:'):
            for id, node in read_manifest(text, 'page.yaml').items():
                registry.register(id, node)
    nodes = ''.join(text for kind, text in blocks if kind == 'xml')
    xml = f'<root BTCPP_format="4"><BehaviorTree ID="A"><Sequence>{nodes}</Sequence></BehaviorTree></root>'
    loaded = [node.manifest.id for node in load_xml(xml, 'page.xml', registry).trees['A'].nodes()]
    assert loaded == [
        'Sequence', 'CallAction', 'CallService', 'Publish', 'ReadTopic', 'CheckTopic', 'SetParameter',
        'CheckParameter', 'DockAt',
    ]  # fmt: skip
