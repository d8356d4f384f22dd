# SPDX-License-Identifier: BSD-3-Clause
"""Conversion of documents from format 3 (BehaviorTree.CPP 3) to format 4. Positions in the file are kept.

It makes the same changes as the converter of BehaviorTree.CPP, and also covers what that converter misses: nodes in
explicit form, <remap> children, and the misspelt RetryUntilSuccesful.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from typing import Final

from flexbt_core.behavior_tree.model.ports import pointer_key

from .parser import Element

_RENAMED_NODES: Final = {
    'SequenceStar': 'SequenceWithMemory',
    'RetryUntilSuccesful': 'RetryUntilSuccessful',
}
_RENAMED_PORTS: Final = {
    'Parallel': {
        'threshold': 'success_count',
        'success_threshold': 'success_count',
        'failure_threshold': 'failure_count',
    },
}
_CHECKS: Final = frozenset(f'BlackboardCheck{kind}' for kind in ('Int', 'Double', 'String', 'Bool'))
_SUBTREES: Final = ('SubTree', 'SubTreePlus')
_EXPLICIT: Final = ('Action', 'Condition', 'Control', 'Decorator')
_KEY: Final = re.compile(r'[A-Za-z_]\w*', re.ASCII)
_NUMBER: Final = re.compile(r'[+-]?\d+(\.\d+)?([eE][+-]?\d+)?')


def is_format_3(root: Element) -> bool:
    """Return whether the document declares format 3, or declares no format and uses features unknown to format 4."""
    format = root.attributes.get('BTCPP_format')
    if format is not None:
        return format.strip() == '3'
    return any(
        _node_id(element) in _OLD_NODES
        or element.tag == 'remap'
        or '__shared_blackboard' in element.attributes
        or not element.attributes.keys().isdisjoint(_RENAMED_PORTS.get(_node_id(element) or '', ()))
        for element in _all(root)
    )


def make_format_4(root: Element) -> None:
    """Rewrite the document in place. The reader of format 4 reports any errors in it."""
    for tree in root.children:
        if tree.tag == 'BehaviorTree':
            for element in list(_all(tree)):
                element.attributes, element.places = element.attributes.copy(), element.places.copy()
                _convert(element)


def _convert(element: Element) -> None:
    id = _node_id(element)
    if element.tag in _SUBTREES:
        _convert_subtree(element)
    elif id in _CHECKS:
        _convert_check(element, id)
    elif id is not None:
        if id in _RENAMED_NODES:
            _rename_node(element, _RENAMED_NODES[id])
        if id == 'Parallel' and 'threshold' in element.attributes:
            # Up to 3.5 it fails as soon as it cannot succeed any more; the number of failures has no separate limit.
            element.attributes.setdefault('failure_threshold', '-1')
            element.places.setdefault('failure_threshold', element.places['threshold'])
        _rename_attributes(element, _RENAMED_PORTS.get(id, {}))


def _convert_subtree(element: Element) -> None:
    """Convert <SubTree>, which names parent entries without braces, and <SubTreePlus>, which has format 4 values."""
    if element.tag == 'SubTreePlus':
        element.tag = 'SubTree'
        _rename_attributes(element, {'__autoremap': '_autoremap'})
        return
    remaps = [child for child in element.children if child.tag == 'remap']
    element.children = [child for child in element.children if child.tag != 'remap']
    for remap in remaps:
        internal, external = remap.attributes.get('internal'), remap.attributes.get('external')
        if internal is not None and external is not None:
            element.attributes.setdefault(internal, external)
            element.places.setdefault(internal, remap.offset - element.offset)
    for name, value in element.attributes.items():
        if name not in ('ID', 'name', '__shared_blackboard') and pointer_key(value, name) is None:
            element.attributes[name] = f'{{{value}}}'
    _rename_attributes(element, {'__shared_blackboard': '_autoremap'})


def _convert_check(element: Element, id: str) -> None:
    """Turn a comparison of two ports into the script of a <Precondition>."""
    text = id == 'BlackboardCheckString'
    sides = [_operand(element.attributes.get(port, ''), port, text) for port in ('value_A', 'value_B')]
    _rename_node(element, 'Precondition')
    element.attributes['value_A'] = ' == '.join(sides)
    element.attributes.pop('value_B', None)
    element.attributes.setdefault('return_on_mismatch', 'FAILURE')
    _rename_attributes(element, {'value_A': 'if', 'return_on_mismatch': 'else'})


def _operand(value: str, port: str, text: bool) -> str:
    key = pointer_key(value, port)
    if key is not None:
        # A script cannot read other entries: [{a-b}] is an error in it, where [a-b] would be a difference.
        return key if _KEY.fullmatch(key) else value
    is_word = not text and (_NUMBER.fullmatch(value) or value in ('true', 'false'))
    return value.removeprefix('+') if is_word else f"'{value}'"


def _rename_node(element: Element, id: str) -> None:
    if element.tag in _EXPLICIT:
        element.attributes['ID'] = id
    else:
        element.tag = id


def _rename_attributes(element: Element, names: Mapping[str, str]) -> None:
    if any(name in element.attributes for name in names):
        element.attributes = {names.get(name, name): value for name, value in element.attributes.items()}
        element.places = {names.get(name, name): place for name, place in element.places.items()}


def _node_id(element: Element) -> str | None:
    return element.attributes.get('ID') if element.tag in _EXPLICIT else element.tag


def _all(root: Element) -> Iterator[Element]:
    stack = [root]
    while stack:
        element = stack.pop()
        yield element
        stack.extend(element.children)


_OLD_NODES: Final = frozenset((*_RENAMED_NODES, *_CHECKS, 'SubTreePlus'))
