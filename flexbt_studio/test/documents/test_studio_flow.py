# SPDX-License-Identifier: BSD-3-Clause
"""Data flow: the page's writers and readers are those of the checker, and of what a machine declares."""

from __future__ import annotations

import itertools
from pathlib import Path
from typing import Any

import pytest
from test_studio_names import FILES, split
from test_xml_key_gestures import Maker

from flexbt_core import builtin_registry, load_xml
from flexbt_core.behavior_tree.model.errors import TreeLoadError
from flexbt_onboard.behaviors.machine_behavior import installed_states
from flexbt_studio.documents.flow import flow, keys_of_group
from flexbt_studio.documents.palette import states
from flexbt_studio.documents.project import Project
from flexbt_studio.documents.text import applied
from flexbt_studio.documents.yaml_document import YamlDocument
from flexbt_tools.behaviors.built_behavior import build, machine_file_entry
from flexbt_tools.trees.key_usage import uses


def written(folder: Path, files: dict[str, str]) -> Project:
    for file, text in files.items():
        (folder / file).parent.mkdir(parents=True, exist_ok=True)
        (folder / file).write_text(text)
    return Project(folder)


@pytest.mark.parametrize('seed', range(40))
def test_the_nodes_of_a_tree_use_keys_as_the_checker_says(seed: int, tmp_path: Path) -> None:
    files = {'Two.xml': split(Maker(seed).document())['Two.xml']}
    project = written(tmp_path, files)
    try:
        loaded = load_xml(files['Two.xml'], 'Two.xml', builtin_registry())
    except TreeLoadError:
        pytest.skip('the engine refuses this tree')
    paths = [node['path'] for node in project.document('Two.xml').view()['nodes']]
    nodes = [*loaded.trees['Two'].nodes()]
    assert len(nodes) == len(paths)
    expected: dict[tuple[str, str], set[str]] = {}
    for path, node in zip(paths, nodes, strict=True):
        for use in uses(node, loaded.scripts.enums):
            words = {'reads'} if use.reads else set()
            words |= {'writes'} if use.writes else set()
            if words:
                expected.setdefault((use.key, path), set()).update(words)
    found: dict[tuple[str, str], set[str]] = {}
    for key in flow(project, 'Two.xml', ()):
        for use in key['uses']:
            words = {word for word in ('reads', 'writes') if word in use['role']}
            if words:
                found.setdefault((key['key'], use['path']), set()).update(words)
    assert found == expected


def by_key(found: list[dict[str, Any]], scope: str) -> dict[str, dict[str, Any]]:
    return {one['key']: one for one in found if one['scope'] == scope}


def test_a_sub_tree_does_what_its_tree_does(tmp_path: Path) -> None:
    inner = '<Sequence><Script code="out := in; own := 1"/><SubTree ID="Loop" x="{in}"/></Sequence>'
    loop = '<Sequence><Script code="x += 1"/><SubTree ID="Loop" x="{x}"/></Sequence>'
    main = '<SubTree ID="Inner" in="{a}" out="{b}"/><SubTree ID="Inner" _autoremap="true"/><Script code="c := b"/>'
    files = {
        name: f'<root BTCPP_format="4"><BehaviorTree ID="{name[:-4]}">{body}</BehaviorTree></root>'
        for name, body in (('Main.xml', f'<Sequence>{main}</Sequence>'), ('Inner.xml', inner), ('Loop.xml', loop))
    }
    keys = by_key(flow(written(tmp_path, files), 'Main.xml', ()), 'Main')
    roles = {key: [(use['path'], use['role']) for use in one['uses']] for key, one in keys.items()}
    assert roles['a'] == [('Main/0/0', 'reads and writes')]  # Loop adds to it
    assert roles['b'] == [('Main/0/0', 'writes'), ('Main/0/2', 'reads')]
    assert roles['own'] == [('Main/0/1', 'writes')]
    inner_keys = by_key(flow(Project(tmp_path), 'Inner.xml', ()), 'Inner')
    assert inner_keys['in']['given'] == 'the tree around it' and inner_keys['own']['given'] == ''


def test_a_state_is_found_by_each_of_its_names() -> None:
    installed = installed_states()[0]
    assert installed['BtLoadState'] is installed['BtLoaderState']
    known = [one['id'].rpartition('/')[2] for one in states(installed)]
    assert set(known) == {name.rpartition('/')[2] for name, one in installed.items() if isinstance(one, type)}
    assert {'BtLoadState', 'BtLoaderState'} <= set(known)


def test_the_states_of_a_machine_use_its_userdata(tmp_path: Path) -> None:
    project = written(tmp_path, FILES)
    palette = states(installed_states()[0])
    keys = by_key(flow(project, 'round.yaml', palette), '/')
    shown = {key: [(use['path'], use['role'], use['name']) for use in one['uses']] for key, one in keys.items()}
    assert shown['goal'] == [('/AskGoal', 'writes', 'data'), ('/Drive', 'reads', 'goal'), ('/Inner', 'reads', 'goal')]
    assert shown['place'] == [('/Tell', 'reads', 'data')] and keys['place']['given'] == 'the machine around it'
    (inner,) = [one for one in flow(project, 'round.yaml', palette) if one['scope'] == '/Inner']
    assert [use['path'] for use in inner['uses']] == ['/Inner/Drive']
    text = FILES['round.yaml']
    assert [text[slice(*one['span'])] for one in keys.values()] == list(keys)


def test_a_group_is_given_the_keys_of_its_states() -> None:
    text = """\
machine:
  outcomes: [done]
  userdata: {place: dock}
  output_keys: [said]
  states:
    Ask:
      state: OperatorInputState
      parameters: {prompt: x, type: std_msgs/String}
      transitions: {received: Tell, declined: Tell, failed: Tell}
      remapping: {data: place}
    Tell:
      state: LogKeyState
      parameters: {text: 'at {}'}
      transitions: {done: Say}
      remapping: {data: place}
    Say:
      state: OperatorInputState
      parameters: {prompt: x, type: std_msgs/String}
      transitions: {received: done, declined: Say, failed: Say}
      remapping: {data: said}
"""
    document, palette = YamlDocument(text), states(installed_states()[0])
    found = {}
    for count in (1, 2, 3):
        for chosen in itertools.combinations(('/Ask', '/Tell', '/Say'), count):
            found[chosen] = keys = keys_of_group(document, chosen, palette)
            if chosen != ('/Ask', '/Say'):  # it would be entered at two states
                edits = document.gesture('group', {'states': [*chosen], 'label': 'Group', 'keys': keys})
                built = build(machine_file_entry('m.yaml', applied(text, edits)), ())
                assert built.machine is not None, (chosen, built)
    assert found['/Ask',] == {'output_keys': ['place']} and found['/Tell',] == {'input_keys': ['place']}
    assert found['/Ask', '/Tell', '/Say'] == {'io_keys': ['place'], 'output_keys': ['said']}
