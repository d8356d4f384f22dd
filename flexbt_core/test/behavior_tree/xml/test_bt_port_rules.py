# SPDX-License-Identifier: BSD-3-Clause
"""How ports of different types get on with one entry: the rules of BehaviorTree.CPP 4.10, each as its tests have it."""

from __future__ import annotations

import re
from typing import Any, ClassVar, NamedTuple

import pytest

from flexbt_core.behavior_tree.engine.leaf import SyncAction
from flexbt_core.behavior_tree.engine.registry import NodeRegistry
from flexbt_core.behavior_tree.engine.tree import Tree
from flexbt_core.behavior_tree.model.blackboard import Blackboard
from flexbt_core.behavior_tree.model.definition import TreeLibrary
from flexbt_core.behavior_tree.model.errors import BlackboardError, NodeExecutionError, TreeLoadError
from flexbt_core.behavior_tree.model.ports import (
    DOUBLE,
    INT,
    INT64,
    STRING,
    UINT8,
    PortType,
    input_port,
    list_of,
    output_port,
)
from flexbt_core.behavior_tree.model.status import NodeStatus
from flexbt_core.behavior_tree.nodes.builtin import builtin_registry
from flexbt_core.behavior_tree.xml.reader import load_xml
from flexbt_core.clock.clock import ManualClock


class Point(NamedTuple):
    x: float
    y: float


def point(text: str) -> Point:
    x, y = text.split(';')
    return Point(float(x), float(y))


class Place(Point):
    """A point with a class of its own."""


POINT = PortType('Point', Point, from_text=point)
PLACE = PortType('Place', Place, from_text=lambda text: Place(*point(text)))
SEEN: list[Any] = []


class Echo(SyncAction):
    """Writes what it reads; twice an integer."""

    def tick(self) -> NodeStatus:
        value = self.get_input('input')
        SEEN.append(value)
        self.set_output('output', value * 2 if type(value) is int else value)
        return NodeStatus.SUCCESS


def echo(name: str, kind: PortType | None) -> type[Echo]:
    return type(name, (Echo,), {'ports': {'input': input_port(kind, optional=True), 'output': output_port(kind)}})


KINDS = {'Int': INT, 'String': STRING, 'Real': DOUBLE, 'Point': POINT, 'Place': PLACE, 'Numbers': list_of(DOUBLE)}


@pytest.fixture
def registry() -> NodeRegistry:
    SEEN.clear()
    nodes = builtin_registry()
    for name, kind in KINDS.items():
        nodes.register(name, echo(name, kind))

    class Any_(SyncAction):
        """A port without a type: it reads what is there, and writes nothing when nothing is."""

        ports: ClassVar[dict[str, Any]] = {'input': input_port(optional=True), 'output': output_port()}

        def tick(self) -> NodeStatus:
            SEEN.append(self.get_input_or('input', None))
            return NodeStatus.SUCCESS

    nodes.register('Any', Any_)
    return nodes


def make(registry: NodeRegistry, body: str, others: str = '') -> Tree:
    text = f'<root BTCPP_format="4" main_tree_to_execute="M"><BehaviorTree ID="M">{body}</BehaviorTree>{others}</root>'
    return Tree(TreeLibrary([load_xml(text, 'file.xml', registry)]), 'M', clock=ManualClock())


def sequence(*children: str) -> str:
    return f'<Sequence>{"".join(children)}</Sequence>'


RUN: dict[str, tuple[str, str, Any]] = {
    'the same type, integer': (sequence('<Int input="21" output="{v}"/>', '<Int input="{v}" output="{r}"/>'), 'r', 84),
    'the same type, text': (
        sequence('<String input="hello" output="{v}"/>', '<String input="{v}" output="{r}"/>'), 'r', 'hello'),
    'the same type of ones own': (
        sequence('<Point input="1.5;2.5" output="{v}"/>', '<Point input="{v}" output="{r}"/>'), 'r', Point(1.5, 2.5)),
    'text to an integer': (
        sequence('<SetBlackboard value="42" output_key="v"/>', '<Int input="{v}" output="{r}"/>'), 'r', 84),
    'text to a real': (
        sequence('<SetBlackboard value="3.14" output_key="v"/>', '<Real input="{v}" output="{r}"/>'), 'r', 3.14),
    'text to a type of ones own': (
        sequence('<SetBlackboard value="1.0;2.0" output_key="v"/>', '<Point input="{v}" output="{r}"/>'),
        'r', Point(1.0, 2.0)),
    'text to a list': ('<Numbers input="1.0;2.0;3.0" output="{r}"/>', 'r', [1.0, 2.0, 3.0]),
    'JSON to a list': ('<Numbers input="json:[1, 2.5]" output="{r}"/>', 'r', [1.0, 2.5]),
    'a derived class to its base': (
        sequence('<Place input="1;2" output="{v}"/>', '<Point input="{v}" output="{r}"/>'), 'r', Place(1.0, 2.0)),
    'a base that holds a derived class': (sequence(
        '<Place input="1;2" output="{p}"/>', '<Point input="{p}" output="{v}"/>', '<Place input="{v}" output="{r}"/>'),
        'r', Place(1.0, 2.0)),
    'through a port without a type': (sequence(
        '<Int input="10" output="{v}"/>', '<Any input="{v}" output="{g}"/>', '<Int input="{v}" output="{r}"/>'),
        'r', 40),
    'text of a port read as an integer': (sequence(
        '<String input="42" output="{v}"/>', '<Int input="{v}" output="{r}"/>', '<Real input="{v}" output="{d}"/>'),
        'r', 84),
    'text of a port read as a real': (sequence(
        '<String input="42" output="{v}"/>', '<Int input="{v}" output="{i}"/>', '<Real input="{v}" output="{r}"/>'),
        'r', 42.0),
    'a literal of a type of ones own': ('<Point input="1.5;2.5" output="{r}"/>', 'r', Point(1.5, 2.5)),
}  # fmt: skip


@pytest.mark.parametrize('what', RUN)
def test_values_pass(registry: NodeRegistry, what: str) -> None:
    body, key, value = RUN[what]
    tree = make(registry, body)
    assert tree.tick_once() is NodeStatus.SUCCESS
    assert tree.blackboard.get(key) == value
    assert type(tree.blackboard.get(key)) is type(value)


def test_a_constant_of_a_sub_tree_is_converted_by_the_port_that_reads_it(registry: NodeRegistry) -> None:
    tree = make(
        registry,
        '<SubTree ID="Sub" values="3;7"/>',
        '<BehaviorTree ID="Sub"><Numbers input="{values}" output="{r}"/></BehaviorTree>',
    )
    assert tree.tick_once() is NodeStatus.SUCCESS
    assert SEEN == [[3.0, 7.0]]


@pytest.mark.parametrize('first', ['<Int input="42" output="{v}"/>', '<String input="hello" output="{v}"/>'])
def test_a_port_without_a_type_takes_what_is_there(registry: NodeRegistry, first: str) -> None:
    assert make(registry, sequence(first, '<Any input="{v}"/>')).tick_once() is NodeStatus.SUCCESS
    assert SEEN[-1] in (84, 'hello')


def test_an_output_without_a_type_may_feed_a_port_with_one(registry: NodeRegistry) -> None:
    make(registry, sequence('<Any output="{v}"/>', '<Int input="{v}" output="{r}"/>'))


CLASHES = {
    'integer and text': ('<Int input="42" output="{v}"/>', '<String input="{v}" output="{r}"/>'),
    'integer and real': ('<Int input="42" output="{v}"/>', '<Real input="{v}" output="{r}"/>'),
    'own type and integer': ('<Point input="1;2" output="{v}"/>', '<Int input="{v}" output="{r}"/>'),
    'a derived class that is written to an entry of its base': ('<Point output="{v}"/>', '<Place output="{v}"/>'),
    'a number without a quote in JSON': ('<Numbers input="json:[1, two]"/>',),
    'text where numbers are expected in JSON': ('<Numbers input="json:[1, &quot;2&quot;]"/>',),
    'JSON that is no list': ('<Numbers input="json:{}"/>',),
    'JSON that is nested without end': (f'<Numbers input="json:{"[" * 9999}"/>',),
    'a bad number': ('<Int input="not_a_number" output="{r}"/>',),
    'a bad literal of a type of ones own': ('<Point input="1.5" output="{r}"/>',),
    'a key that is at the root of the root': ('<Int input="1" output="{@@v}"/>',),
}


@pytest.mark.parametrize('what', CLASHES)
def test_types_that_clash_are_refused_when_the_tree_is_made(registry: NodeRegistry, what: str) -> None:
    body = sequence(*CLASHES[what])
    with pytest.raises(TreeLoadError) as caught:
        make(registry, body)
    (error,) = caught.value.errors
    head = '<root BTCPP_format="4" main_tree_to_execute="M"><BehaviorTree ID="M">'
    place = f'{head}{body}'[error.column - 1 :]
    assert re.match(r'(in|out)put="', place) and f'port [{place.partition("=")[0]}]' in error.message


def test_the_type_of_an_entry_cannot_be_changed_by_a_copy(registry: NodeRegistry) -> None:
    tree = make(registry, sequence(
        '<SetBlackboard value="{point_value}" output_key="other"/>', '<Sleep msec="5"/>',
        '<SetBlackboard value="{string_value}" output_key="other"/>'))  # fmt: skip
    tree.blackboard.set('point_value', Point(2, 7))
    tree.blackboard.set('string_value', 'Hello!')
    assert tree.tick_once() is NodeStatus.RUNNING
    clock = tree.context.clock
    assert isinstance(clock, ManualClock)
    clock.advance(0.005)
    with pytest.raises(NodeExecutionError, match=r'entry \[other\] of type .* cannot be written as text'):
        tree.tick_once()


def test_text_makes_an_entry_without_a_type_which_a_number_gives_one() -> None:
    board = Blackboard()
    board.set('key', '42')
    entry = board.entry('key')
    assert entry is not None and entry.type is None
    board.set('key', 42)
    assert (entry := board.entry('key')) is not None
    assert entry.type is not None and entry.type.python_type is int


def test_a_number_makes_an_entry_that_takes_nothing_else() -> None:
    board = Blackboard()
    board.set('key', 42)
    for other in ('hello', 3.14, Point(1, 2)):
        with pytest.raises(BlackboardError):
            board.set('key', other)
    assert board.get('key') == 42


def test_integers_of_other_sizes_are_taken_as_long_as_they_fit() -> None:
    board = Blackboard()
    board.set('key', 100, UINT8)
    board.set('key', 50)
    assert board.get('key') == 50
    for value in (300, -1):
        with pytest.raises(BlackboardError):
            board.set('key', value)
    board.set('wide', 100, INT64)
    board.set('wide', 1_000_000, INT64)
    assert board.get('wide') == 1_000_000
