# SPDX-License-Identifier: BSD-3-Clause
"""Which names are allowed for trees, sub-trees, instances and ports: the cases of BehaviorTree.CPP 4.10 (its wheel,
4.8.2, does not look at names). Trees may have blanks in their names, as there."""

from __future__ import annotations

import pytest

from flexbt_core.behavior_tree.engine.registry import NodeRegistry
from flexbt_core.behavior_tree.model.definition import TreeLibrary, model_name_problem, port_name_problem
from flexbt_core.behavior_tree.model.errors import TreeLoadError
from flexbt_core.behavior_tree.nodes.builtin import builtin_registry
from flexbt_core.behavior_tree.xml.reader import load_xml

GOOD = ['ValidName', 'my_action', 'My-Action', 'action123', 'CamelCaseNode', 'snake_case_node', 'kebab-case-node',
        '检查门状态', 'ドアを開ける', 'Tür_öffnen', 'проверка', 'действие', 'My_Main_Tree']  # fmt: skip
BAD = {
    'My Action': ' ', 'with\ttab': '\t', 'with\nnewline': '\n', 'with\rcarriage': '\r', 'My<Node>': '<',
    'Node>End': '>', 'A&B': '&', 'say"hello"': '"', "it's": "'", 'path/to/node': '/', 'path\\to\\node': '\\',
    'C:drive': ':', 'wild*card': '*', 'what?': '?', 'pipe|char': '|', 'request.name': '.', 'file.ext': '.',
    'test\0name': '\0', 'test\x07bell': '\x07', 'test\x7fdel': '\x7f',
}  # fmt: skip


@pytest.mark.parametrize('name', GOOD)
def test_allowed_names(name: str) -> None:
    assert not model_name_problem(name)


@pytest.mark.parametrize(('name', 'character'), BAD.items())
def test_forbidden_characters_are_named(name: str, character: str) -> None:
    problem = f"name '{name}' contains the character {character!r}, which is not allowed there"
    assert model_name_problem(name) == problem
    assert port_name_problem(f'p{name}') == problem.replace(name, f'p{name}', 1)


def test_reserved_names() -> None:
    assert model_name_problem('') == 'the name of a tree or node type cannot be empty'
    for name in ('Root', 'root'):
        assert model_name_problem(name) == f"'{name}' is a reserved name"


@pytest.mark.parametrize('name', ['input', 'output_value', 'myPort123', 'Port_With_Underscore'])
def test_allowed_names_of_ports(name: str) -> None:
    assert not port_name_problem(name)


RESERVED = ('name', 'ID', '_failureIf', '_successIf', '_skipIf', '_while', '_onSuccess', '_onFailure', '_onHalted',
            '_post', '_autoremap')  # fmt: skip


def test_names_that_no_port_can_have() -> None:
    assert port_name_problem('') == 'a port name cannot be empty'
    for name in RESERVED:
        assert port_name_problem(name) == f"'{name}' is a reserved attribute name"
    for name in ('1port', '123', '_private', 'été'):
        assert port_name_problem(name) == f"port name '{name}' has to begin with a letter"


def tree(id: str, body: str = '<AlwaysSuccess/>') -> str:
    return f'<BehaviorTree ID="{id}">{body}</BehaviorTree>'


def model(port: str) -> str:
    return f'<TreeNodesModel><SubTree ID="Sub"><input_port name="{port}"/></SubTree></TreeNodesModel>'


ACCEPTED = {
    'a tree': tree('MainTree'),
    'a tree with an underscore': tree('My_Main_Tree'),
    'a Chinese tree': tree('检查门'),
    'a German tree': tree('Türöffner'),
    'trees with blanks': tree('Main Tree', '<SubTree ID="Sub Tree"/>') + tree('Sub Tree'),
    'an instance': tree('M', '<AlwaysSuccess name="my_success_node"/>'),
    'an instance with spaces': tree('M', '<AlwaysSuccess name="my success node"/>'),
    'an instance with a period': tree('M', '<AlwaysSuccess name="node.name"/>'),
    'a Japanese instance': tree('M', '<AlwaysSuccess name="成功ノード"/>'),
    'a sub-tree': tree('M', '<SubTree ID="Sub1"/>') + tree('Sub1'),
    'a port of a sub-tree': tree('M', '<SubTree ID="Sub" input_value="{value}"/>') + tree('Sub') + model('input_value'),
}
REFUSED = {
    'a tree Root': tree('Root'),
    'a tree root': tree('root'),
    'a tree with a blank before its name': tree(' Main'),
    'a tree with a period': tree('Main.Tree'),
    'a tree without a name': tree('') + tree('Other'),
    'trees without IDs': '<BehaviorTree><AlwaysSuccess/></BehaviorTree>' * 2,
    'a sub-tree with a tabulator': tree('M', '<SubTree ID="Sub&#9;Tree"/>') + tree('Sub&#9;Tree'),
    'a port with a space': tree('M') + model('input value'),
    'a port named ID': tree('M') + model('ID'),
    'a port that begins with a digit': tree('M') + model('1port'),
    'a model without an ID': tree('M') + '<TreeNodesModel><SubTree/></TreeNodesModel>',
}


def load(content: str) -> TreeLibrary:
    registry: NodeRegistry = builtin_registry()
    return TreeLibrary([load_xml(f'<root BTCPP_format="4">{content}</root>', 'file.xml', registry)])


@pytest.mark.parametrize('what', ACCEPTED)
def test_what_is_accepted_in_a_file(what: str) -> None:
    load(ACCEPTED[what])


@pytest.mark.parametrize('what', REFUSED)
def test_what_is_refused_in_a_file(what: str) -> None:
    with pytest.raises(TreeLoadError):
        load(REFUSED[what])
