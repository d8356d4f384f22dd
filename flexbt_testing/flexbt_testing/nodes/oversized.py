# SPDX-License-Identifier: BSD-3-Clause
"""Oversized messages, derived from their interface definitions: one for each text and list."""

from __future__ import annotations

import math
from array import array
from collections.abc import Iterator
from typing import Any, Final

from rclpy.serialization import serialize_message
from rosidl_parser.definition import AbstractSequence, AbstractString, BasicType, BoundedSequence, NamespacedType

from flexbt_common.values.value_types import resolve_type

TOO_MUCH: Final = 10_000_000
"""Bytes in the oversized field."""

_TEXT_OF_LIST: Final = 995
"""Characters of each text in a list: the maximum for a text, so that only the list is oversized."""

MOST_ELEMENTS: Final = 21_000
"""Maximum elements of a list of messages: making them costs more than refusing them."""

_ARRAY_CODES: Final = {
    'uint8': 'B',
    'int8': 'b',
    'uint16': 'H',
    'int16': 'h',
    'int32': 'i',
    'uint32': 'I',
    'int64': 'q',
    'uint64': 'Q',
    'float': 'f',
    'double': 'd',
}
_OTHER_ELEMENTS: Final[dict[str, Any]] = {'boolean': True, 'octet': b'x'}
"""Elements of types whose sequences are not arrays in Python."""


def oversized(
    message_type: type[Any], most: int = TOO_MUCH, elements: int = MOST_ELEMENTS
) -> Iterator[tuple[str, Any]]:
    """Yield, for each text and list of a message at any depth, its path and a message with ``most`` bytes in it alone.

    A list of messages has at most ``elements`` elements.
    """
    fields = message_type.get_fields_and_field_types()
    for name, slot in zip(fields, message_type.SLOT_TYPES, strict=True):
        for path, value in _values(slot, most, elements):
            yield name + path, message_type(**{name: value})


def _values(slot: Any, most: int, elements: int) -> Iterator[tuple[str, Any]]:
    if isinstance(slot, AbstractString):
        yield '', 'x' * most
    elif isinstance(slot, NamespacedType):
        for path, message in oversized(_class_of(slot), most, elements):
            yield f'.{path}', message
    elif isinstance(slot, AbstractSequence) and not isinstance(slot, BoundedSequence):
        element = slot.value_type
        if isinstance(element, BasicType):
            if element.typename in _OTHER_ELEMENTS:
                yield '', [_OTHER_ELEMENTS[element.typename]] * (most // 8)  # as many elements as int64 would need
            else:
                yield '', array(_ARRAY_CODES[element.typename], bytes(most))
            return
        if isinstance(element, AbstractString):
            yield '', ['x' * _TEXT_OF_LIST] * math.ceil(most / _TEXT_OF_LIST)
        else:
            one = _class_of(element)()
            yield '', [one] * min(elements, math.ceil(most / len(serialize_message(one))))
        for path, value in _values(element, most, elements):
            yield f'[0]{path}', [value]


def _class_of(slot: Any) -> type[Any]:
    message = resolve_type(f'{slot.namespaces[0]}/msg/{slot.name}').message
    assert message is not None
    return message
