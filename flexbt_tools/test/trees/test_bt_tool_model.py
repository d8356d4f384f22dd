# SPDX-License-Identifier: BSD-3-Clause
"""``bt_tool model``: the models and the schema say what the registry knows."""

from __future__ import annotations

import contextlib
import re
from pathlib import Path
from xml.etree import ElementTree

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from lxml import etree

from flexbt_core.behavior_tree.engine.leaf import SyncAction
from flexbt_core.behavior_tree.engine.registry import NodeRegistry
from flexbt_core.behavior_tree.model import ports
from flexbt_core.behavior_tree.model.definition import FORBIDDEN_IN_NAMES, RESERVED_ATTRIBUTES, NodeManifest
from flexbt_core.behavior_tree.model.errors import TreeLoadError
from flexbt_core.behavior_tree.model.ports import NO_DEFAULT, Port, PortDirection, PortType
from flexbt_core.behavior_tree.model.status import NodeKind, NodeStatus
from flexbt_core.behavior_tree.nodes.builtin import builtin_registry
from flexbt_server.groot2.protocol import models_document
from flexbt_server.node_types import node_registry
from flexbt_testing.behavior_trees.bt_tool import STOCK_TREES, document, tool
from flexbt_testing.behavior_trees.random_trees import wheel_case
from flexbt_tools.trees.schema import schema_lines
from flexbt_tools.trees.stand_ins import add_models

Signature = dict[str, tuple[PortDirection, str | None, str | None]]


def signatures(registry: NodeRegistry) -> dict[str, tuple[NodeKind, Signature]]:
    """Kinds and ports of all node types: direction, type, default as text."""
    return {
        manifest.id: (
            manifest.kind,
            {
                name: (
                    port.direction,
                    None if port.type is None else port.type.name,
                    None if port.default is NO_DEFAULT else str(port.default),
                )
                for name, port in manifest.ports.items()
            },
        )
        for manifest in registry
        if manifest.kind is not NodeKind.SUBTREE
    }


MODEL = tool('model', '--builtin').out


def test_the_model_says_what_the_registry_knows() -> None:
    read = NodeRegistry()
    assert add_models(read, 'model.xml', MODEL) == []
    assert signatures(read) == signatures(node_registry(lambda source, error: None))


def test_the_nodes_that_groot2_knows_are_left_out() -> None:
    read = NodeRegistry()
    add_models(read, 'model.xml', tool('model').out)
    assert 'Wait' in read
    assert not {manifest.id for manifest in read} & {manifest.id for manifest in builtin_registry()}


NAMES = st.from_regex(r'[A-Za-z][A-Za-z0-9_(){}\u00e9-]{0,8}', fullmatch=True).filter(
    lambda name: name not in RESERVED_ATTRIBUTES
)
TEXTS = st.text(st.characters(codec='utf-8', exclude_categories=['Cc', 'Cs'], exclude_characters='\ufffe\uffff'))
TYPES = st.sampled_from([None, *(kind for kind in vars(ports).values() if isinstance(kind, PortType))])


@given(NAMES, st.dictionaries(NAMES, st.tuples(st.sampled_from(PortDirection), TYPES, TEXTS), max_size=4), TEXTS)
def test_any_ports_go_into_a_model_and_back(
    id: str, ports: dict[str, tuple[PortDirection, PortType | None, str]], text: str
) -> None:
    assert not set(id) & FORBIDDEN_IN_NAMES
    made = {name: Port(direction, kind, '{=}', words) for name, (direction, kind, words) in ports.items()}

    class Made(SyncAction):
        __doc__ = text
        ports = made

        def tick(self) -> NodeStatus:
            return NodeStatus.SUCCESS

    written, read = NodeRegistry(), NodeRegistry()
    written.register(id, Made)
    model = '\n'.join(models_document(written))
    assert add_models(read, 'model.xml', model) == []
    assert signatures(read) == signatures(written)
    described = {port.get('name'): port.text or '' for port in ElementTree.fromstring(model)[0][0] if port.get('name')}  # noqa: S314
    assert {name: words.replace('\r', '\n') for name, (_, _, words) in ports.items()} == described


def schema(text: str) -> etree.XMLSchema:
    return etree.XMLSchema(etree.fromstring(text.encode()))


def errors(by: etree.XMLSchema, text: str) -> list[str]:
    """Return what a schema refuses in a document."""
    by.validate(etree.fromstring(text.encode()))
    return [error.message for error in by.error_log]


SCHEMA = schema(tool('model', '--xsd').out)
PACKAGED_TREES = [
    file
    for package in ('flexbt_demo_behaviors', 'flexbt_server')
    for file in sorted((Path(__file__).parents[3] / package).rglob('*.xml'))
    if file.name != 'package.xml'
]


@pytest.mark.parametrize('tree', STOCK_TREES, ids=lambda tree: tree.stem)
def test_the_trees_of_nav2_are_valid_by_the_schema(tree: Path) -> None:
    installed = {manifest.id for manifest in node_registry(lambda source, error: None)}
    text = tree.read_text(encoding='utf-8')
    missing = {tag for tag in re.findall(r'<([A-Z]\w+)', text) if tag not in installed} - {'BehaviorTree'}
    found = errors(SCHEMA, text)
    assert len(found) == len(missing)
    assert all(any(f"'{tag}'" in error for tag in missing) for error in found)


@pytest.mark.parametrize('file', PACKAGED_TREES, ids=lambda file: file.stem)
def test_the_trees_of_our_packages_are_valid_by_the_schema(file: Path) -> None:
    assert errors(SCHEMA, file.read_text(encoding='utf-8')) == []


@pytest.mark.parametrize(
    ('tree', 'expected'),
    [
        ('<Sequence><AlwaysSuccess name="x" _skipIf="a &lt; 1"/></Sequence>', ''),
        ('<Action ID="Sleep" msec="0"/>', ''),
        ('<SubTree ID="Other" at="all"/>', ''),
        ('<Repeat num_cycles="{n}"><AlwaysSuccess/></Repeat>', ''),
        ('<Repeat num_cycles=" = "><AlwaysSuccess/></Repeat>', ''),
        ('<Sleep msec="1500"/>', ''),
        ('<SetBlackboard value="x" output_key="y"/>', ''),
        ('<Nothing/>', "Element 'Nothing': This element is not expected."),
        ('<AlwaysSuccess><AlwaysSuccess/></AlwaysSuccess>', "Element 'AlwaysSuccess': Element content is not allowed"),
        ('<Sequence/>', "Element 'Sequence': Missing child element(s)."),
        ('<Inverter><AlwaysSuccess/><AlwaysSuccess/></Inverter>', "Element 'AlwaysSuccess': This element is not"),
        ('<Sleep/>', "Element 'Sleep': The attribute 'msec' is required but missing."),
        ('<Sleep msec="long"/>', "Element 'Sleep', attribute 'msec': 'long' is not a valid value"),
        ('<RunOnce then_skip="yes"><AlwaysSuccess/></RunOnce>', "Element 'RunOnce', attribute 'then_skip': 'yes' is"),
        ('<RateController hz=""><AlwaysSuccess/></RateController>', "Element 'RateController', attribute 'hz': '' is"),
        ('<LoopInt queue="1;2" value="3"><AlwaysSuccess/></LoopInt>', "Element 'LoopInt', attribute 'value': [facet"),
        ('<Sleep msec="1" mesc="1"/>', "Element 'Sleep', attribute 'mesc': The attribute 'mesc' is not allowed."),
        ('<AlwaysSuccess/><AlwaysSuccess/>', "Element 'AlwaysSuccess': This element is not expected."),
        ('<SubTree/>', "Element 'SubTree': The attribute 'ID' is required but missing."),
    ],
)  # fmt: skip
def test_the_schema_refuses_what_the_engine_refuses(tmp_path: Path, tree: str, expected: str) -> None:
    text = document(f'Main: {tree}', 'Other: <AlwaysSuccess/>')
    found = errors(SCHEMA, text)
    assert len(found) == bool(expected)
    assert all(error.startswith(expected) for error in found)
    file = tmp_path / 'tree.xml'
    file.write_text(text)
    assert tool('check', '--ignore', 'never-written', str(file)).code == bool(expected)


@pytest.mark.parametrize('seed', range(0, 60, 3))
def test_random_trees_are_valid_by_the_schema(seed: int) -> None:
    """Types of the generator that are not registered are written in explicit form."""
    text = wheel_case(seed)['xml']
    for id, kind in (('Act', 'Action'), ('Sync', 'Action'), ('Cond', 'Condition'), ('Deco', 'Decorator')):
        text = re.sub(rf'<{id}\b', f'<{kind} ID="{id}"', text).replace(f'</{id}>', f'</{kind}>')
    assert errors(SCHEMA, text) == []


def test_a_name_that_no_element_can_have_is_left_out() -> None:
    """Such a node is written in explicit form."""

    class Odd(SyncAction):
        ports = {'x(y)': Port(PortDirection.INPUT)}

        def tick(self) -> NodeStatus:
            return NodeStatus.SUCCESS

    registry = NodeRegistry()
    manifests: list[NodeManifest] = [registry.register(id, Odd) for id in ('2nd', 'é', 'a(b)')]
    made = schema('\n'.join(schema_lines(manifests)))
    assert errors(made, document('Main: <Action ID="2nd"/>')) == errors(made, document('Main: <é/>')) == []
    assert len(errors(made, document('Main: <AlwaysSuccess/>'))) == 1


@settings(max_examples=60, deadline=None)
@given(st.data())
def test_damaged_models_are_refused_or_read(data: st.DataObject) -> None:
    text = MODEL
    for _ in range(data.draw(st.integers(1, 4))):
        position = data.draw(st.integers(0, len(text)))
        damage = data.draw(st.text(st.sampled_from('<>/"= &;IDabx:{}'), max_size=8))
        text = text[:position] + damage + text[position + data.draw(st.integers(0, 20)) :]
    with contextlib.suppress(TreeLoadError):
        assert all(error.line >= 1 for error in add_models(NodeRegistry(), 'model.xml', text))
