# SPDX-License-Identifier: BSD-3-Clause
"""Every installed action, service and message can be written and read from XML, field by field, without a class."""

from __future__ import annotations

import math
import random
from collections.abc import Iterator
from typing import Any
from xml.sax.saxutils import quoteattr

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from rosidl_parser.definition import AbstractSequence, Array, NamespacedType

from flexbt_common.values.fields import Field, constants_of
from flexbt_common.values.value_types import interface_class, interface_names
from flexbt_core import Blackboard, ManualClock, Tree, TreeLibrary, load_xml
from flexbt_server.leaves.message_ports import MessageLeaf
from flexbt_server.node_types import node_registry

REGISTRY = node_registry(lambda source, error: None)
TAGS = {
    'action': ('CallAction', 'server_name', 'goal', 'result'),
    'srv': ('CallService', 'service_name', 'request', 'response'),
    'msg': ('Publish', 'topic_name', 'message', ''),
}
INTERFACES = [(name, kind) for kind in TAGS for name in interface_names(kind)]
DEEPEST = 5
MOST_FIELDS = 60


def leaf_paths(message: type[Any], chance: random.Random, before: str = '', depth: int = 0) -> Iterator[str]:
    """Yield the paths of all fields that are no messages; of lists of messages those of the first two elements."""
    for name in message.get_fields_and_field_types():
        path = f'{before}{name}'
        slot = Field(message, name).slot
        element = slot.value_type if isinstance(slot, Array | AbstractSequence) else slot
        if not isinstance(element, NamespacedType):
            yield path
        elif depth < DEEPEST:
            inner = interface_class(f'{element.namespaces[0]}/msg/{element.name}', 'msg')
            most = min(2, getattr(slot, 'maximum_size', 2)) if element is not slot else 0
            places = [f'{path}.{index}.' for index in range(most)] if element is not slot else [f'{path}.']
            for place in places:
                yield from leaf_paths(inner, chance, place, depth + 1)


def random_value(field: Field, chance: random.Random) -> Any:
    slot = field.slot
    if isinstance(slot, Array | AbstractSequence):
        size = slot.size if isinstance(slot, Array) else chance.randint(0, min(3, getattr(slot, 'maximum_size', 3)))
        return [random_scalar(field.type_name.removesuffix('[]'), chance) for _ in range(size)]
    return random_scalar(field.type_name, chance)


def random_scalar(kind: str, chance: random.Random) -> Any:
    if kind == 'bool':
        return chance.random() < 0.5
    if kind.startswith('float'):
        return chance.choice([0.0, -1.5, 0.25, 1024.0])
    if kind == 'string':
        return ''.join(chance.choices('aZ9 é"<&\'', k=chance.randint(0, 3)))
    bits = int(''.join(filter(str.isdigit, kind)))
    low, high = (-(1 << (bits - 1)), (1 << (bits - 1)) - 1) if kind.startswith('int') else (0, (1 << bits) - 1)
    return chance.choice([low, high, chance.randint(low, high)])


def written(value: Any) -> str | None:
    """Return the text of a value in XML; None for one that has none."""
    if isinstance(value, list):
        pieces = [written(item) for item in value]
        return None if any(not piece or ';' in piece for piece in pieces) else ';'.join(map(str, pieces))
    return str(value).lower() if isinstance(value, bool) else str(value)


def leaf_class(tag: str) -> type[MessageLeaf]:
    manifest = REGISTRY.get(tag)
    assert manifest is not None
    found: type[MessageLeaf] = manifest.node_class
    return found


def leaf_of(tag: str, attributes: dict[str, str], board: Blackboard) -> MessageLeaf:
    text = ' '.join(f'{name}={quoteattr(value)}' for name, value in attributes.items())
    xml = f'<root BTCPP_format="4"><BehaviorTree ID="M"><{tag} {text}/></BehaviorTree></root>'
    tree = Tree(TreeLibrary([load_xml(xml, 'x.xml', REGISTRY)]), 'M', clock=ManualClock(), blackboard=board)
    (leaf,) = tree.nodes
    assert isinstance(leaf, MessageLeaf)
    return leaf


@pytest.mark.parametrize(('name', 'kind'), INTERFACES)
@settings(max_examples=2, deadline=None)
@given(seed=st.integers(0, 2**32))
def test_every_field_of_every_interface_is_written_and_read(name: str, kind: str, seed: int) -> None:
    chance = random.Random(seed)
    tag, target, sent, received = TAGS[kind]
    interface = interface_class(name, kind)
    board, attributes = Blackboard(), {'type': name, target: 'x'}
    parts = leaf_class(tag).parts
    message_class = parts[sent].of(interface)
    wanted = message_class()
    paths = sorted(leaf_paths(message_class, chance), key=lambda path: Field(message_class, path).steps)[:MOST_FIELDS]
    for number, path in enumerate(paths):
        field = Field(message_class, path)
        value = random_value(field, chance)
        field.set(wanted, value)
        text = written(value)
        if text is None or text.startswith(('{', '=', '$')) or chance.random() < 0.4:
            board.set(f'k{number}', value)
            text = f'{{k{number}}}'
        elif isinstance(value, float) and math.isfinite(value) and chance.random() < 0.5:
            text = f'${{{value} + 0.0}}'
        attributes[f'{sent}.{path}'] = text
    leaf = leaf_of(tag, attributes, board)
    made = leaf.message(sent)
    assert made == wanted
    if received:
        answer = parts[received].of(interface)
        outputs = [path for path in leaf_paths(answer, chance) if not any(step.isdigit() for step in path.split('.'))]
        wanted = answer()
        for path in outputs:
            Field(answer, path).set(wanted, random_value(Field(answer, path), chance))
        ports = {f'{received}.{path}': f'{{o{number}}}' for number, path in enumerate(outputs)}
        board = Blackboard()
        leaf_of(tag, {'type': name, target: 'x'} | ports, board).take(received, wanted)
        for number, path in enumerate(outputs):
            assert board.get(f'o{number}') == Field(answer, path).get(wanted), path


def test_constants_stand_for_their_numbers() -> None:
    name = 'nav2_msgs/msg/CollisionMonitorState'
    assert constants_of(interface_class(name, 'msg'))['LIMIT'] == 4
    leaf = leaf_of('Publish', {'type': name, 'topic_name': 'x', 'message.action_type': 'LIMIT'}, Blackboard())
    assert leaf.message('message').action_type == 4
