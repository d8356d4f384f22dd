# SPDX-License-Identifier: BSD-3-Clause
"""Defaults of ports, what is given instead of them, and attributes that are no ports: the cases of BehaviorTree.CPP."""

from __future__ import annotations

from typing import Any, ClassVar, NamedTuple

import pytest

from flexbt_core.behavior_tree.engine.leaf import SyncAction
from flexbt_core.behavior_tree.engine.registry import NodeRegistry
from flexbt_core.behavior_tree.engine.tree import Tree
from flexbt_core.behavior_tree.model.blackboard import Blackboard
from flexbt_core.behavior_tree.model.definition import TreeLibrary
from flexbt_core.behavior_tree.model.errors import ConversionError, PortError, TreeLoadError
from flexbt_core.behavior_tree.model.ports import (
    DOUBLE,
    INT,
    INT64,
    STRING,
    UINT64,
    PortType,
    cast,
    input_port,
    list_of,
    output_port,
)
from flexbt_core.behavior_tree.model.status import NodeStatus
from flexbt_core.behavior_tree.nodes.builtin import builtin_registry
from flexbt_core.behavior_tree.xml.reader import load_xml


class Point(NamedTuple):
    x: int
    y: int


def point(text: str) -> Point:
    x, y = text.split(',')
    return Point(int(x), int(y))


POINT = PortType('Point', Point, from_text=point)


class Sees(SyncAction):
    """Gives what its ports have to the test."""

    def tick(self) -> NodeStatus:
        self.services.append({name: self.get_input(name) for name, port in self.ports.items() if port.readable})
        return NodeStatus.SUCCESS


class Defaults(Sees):
    ports: ClassVar[dict[str, Any]] = {
        'answer': input_port(INT, default='42'),
        'greeting': input_port(STRING, default='hello'),
        'pos': input_port(POINT, default='1,2'),
        'elsewhere': input_port(POINT, default='{point}'),
        'same': input_port(STRING, default='{=}'),
        'none': input_port(list_of(DOUBLE), default=''),
    }


class Needs(Sees):
    ports: ClassVar[dict[str, Any]] = {
        'first': input_port(INT, default='1'),
        'second': input_port(INT),
        'states': input_port(list_of(STRING), default=''),
        'out': output_port(INT),
    }


def make(body: str, others: str = '', **entries: Any) -> tuple[Tree, list[dict[str, Any]]]:
    registry: NodeRegistry = builtin_registry()
    registry.register('Defaults', Defaults)
    registry.register('Needs', Needs)
    seen: list[dict[str, Any]] = []
    text = f'<root BTCPP_format="4" main_tree_to_execute="M"><BehaviorTree ID="M">{body}</BehaviorTree>{others}</root>'
    board = Blackboard()
    for key, value in entries.items():
        board.set(key, value)
    return Tree(TreeLibrary([load_xml(text, 'f', registry)]), 'M', blackboard=board, services=seen), seen


def test_defaults_are_literals_pointers_and_keys_of_the_same_name() -> None:
    tree, seen = make('<Defaults/>', point=Point(3, 4), same='ciao')
    assert tree.tick_once() is NodeStatus.SUCCESS
    assert seen == [
        {'answer': 42, 'greeting': 'hello', 'pos': Point(1, 2), 'elsewhere': Point(3, 4), 'same': 'ciao', 'none': []}
    ]


def test_a_default_that_points_to_an_entry_does_not_declare_it() -> None:
    tree, _ = make('<Sequence><Defaults/><Needs second="{point}"/></Sequence>')
    assert {key: entry.type for key, entry in tree.blackboard.entries().items()} == {'point': INT}


def test_what_is_given_takes_the_place_of_a_default() -> None:
    tree, seen = make(
        '<Defaults answer="7" greeting="" pos="{p}" elsewhere="5,6" same="hola" none="1;2"/>', p=Point(8, 9)
    )
    assert tree.tick_once() is NodeStatus.SUCCESS
    assert seen == [
        {'answer': 7, 'greeting': '', 'pos': Point(8, 9), 'elsewhere': Point(5, 6), 'same': 'hola', 'none': [1.0, 2.0]}
    ]


@pytest.mark.parametrize(
    'body', ['<Defaults answer=""/>', '<Defaults pos=""/>', '<Needs/>', '<Needs second="1" da_port="66"/>']
)
def test_an_empty_text_a_missing_and_an_unknown_port_are_refused(body: str) -> None:
    with pytest.raises(TreeLoadError):
        make(body)


def test_a_pointer_to_what_nobody_has_written_is_an_error_of_the_node() -> None:
    tree, _ = make('<Needs second="{ip}" out="{ip}"/>')
    with pytest.raises(Exception, match=r'port \[second\]') as caught:
        tree.tick_once()
    assert isinstance(caught.value.__cause__, PortError)


def test_a_list_of_texts_is_split_at_semicolons_only() -> None:
    tree, seen = make('<Needs second="1" states="hello;world;with spaces"/>')
    tree.tick_once()
    assert seen[0]['states'] == ['hello', 'world', 'with spaces']


def test_descriptions_may_be_anywhere() -> None:
    tree, seen = make(
        '<Sequence><Needs second="66" _description="my action"/><SubTree ID="Sub" _description="my tree"/></Sequence>',
        '<BehaviorTree ID="Sub" _description="a tree"><Needs name="third" second="99"/></BehaviorTree>',
    )
    assert tree.tick_once() is NodeStatus.SUCCESS
    assert [each['second'] for each in seen] == [66, 99]


def test_other_attributes_are_kept_for_who_wants_them() -> None:
    tree, _ = make('<Action ID="Needs" name="n" second="66" _not_da_port="whateva" _skipIf="true"/>')
    assert tree.definitions[0].extra == {'_not_da_port': 'whateva'}
    assert tree.tick_once() is NodeStatus.SKIPPED


@pytest.mark.parametrize(
    ('value', 'kind', 'fits'),
    [
        (2.0**63, INT64, False), (-(2.0**63), INT64, True), (2.0**64, UINT64, False), (2.0**53, INT64, True),
        ('9223372036854775807', INT64, True), ('9223372036854775808', INT64, False), ('-9223372036854775808', INT64,
            True),
        ('18446744073709551615', UINT64, True), ('18446744073709551616', UINT64, False),
    ],
)  # fmt: skip
def test_the_limits_of_integers(value: Any, kind: PortType, fits: bool) -> None:
    if fits:
        assert cast(value, kind) == (int(value))
    else:
        with pytest.raises(ConversionError):
            cast(value, kind)
