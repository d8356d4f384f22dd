# SPDX-License-Identifier: BSD-3-Clause
"""Copies of messages and bounds of their sizes, against serialization."""

from __future__ import annotations

import importlib
import inspect
import random
import string
from typing import Any, Final

import pytest
from rcl_interfaces.msg import ParameterValue
from rclpy.serialization import deserialize_message, serialize_message

from flexbt_testing.one_process.copying import copied, most_bytes

PACKAGES: Final = (
    'action_msgs',
    'builtin_interfaces',
    'diagnostic_msgs',
    'flexbt_msgs',
    'geometry_msgs',
    'nav_msgs',
    'rcl_interfaces',
    'sensor_msgs',
    'std_msgs',
    'tf2_msgs',
    'unique_identifier_msgs',
)
LETTERS: Final = f'{string.printable}äß€日本😀'


def message_types(package: str) -> list[Any]:
    module = importlib.import_module(f'{package}.msg')
    return [kind for _, kind in inspect.getmembers(module, inspect.isclass) if hasattr(kind, 'SLOT_TYPES')]


def fill(message: Any, chance: random.Random, depth: int = 0) -> None:
    """Set the fields of a message to random values."""
    for name, slot in zip(message.get_fields_and_field_types(), message.SLOT_TYPES, strict=True):
        if hasattr(slot, 'value_type'):
            count = getattr(slot, 'size', None) or chance.randrange(min(4, getattr(slot, 'maximum_size', 4) + 1))
            setattr(message, name, [value(slot.value_type, chance, depth) for _ in range(count)])
        else:
            setattr(message, name, value(slot, chance, depth))


def value(slot: Any, chance: random.Random, depth: int) -> Any:
    """Return a random value of a type of the interface."""
    kind = getattr(slot, 'typename', '')
    if hasattr(slot, 'namespaces'):
        made = getattr(importlib.import_module('.'.join(slot.namespaces)), slot.name)()
        if depth < 4:
            fill(made, chance, depth + 1)
        return made
    if not kind:  # a text
        longest = getattr(slot, 'maximum_size', 200)
        return ''.join(chance.choices(LETTERS, k=chance.choice((0, 1, 7, longest)) % (longest + 1)))
    if kind == 'boolean':
        return chance.random() < 0.5
    if kind == 'octet':
        return bytes([chance.randrange(256)])
    if kind in ('float', 'double'):
        return chance.choice((0.0, -0.1, 1e30, chance.random()))
    bits = int(kind.strip('uint'))
    return chance.randrange(2**bits) - (0 if kind.startswith('u') else 2 ** (bits - 1))


@pytest.mark.parametrize('package', PACKAGES)
def test_a_copy_is_what_a_transport_delivers_and_no_message_is_larger_than_its_bound(package: str) -> None:
    for kind in message_types(package):
        for seed in range(5):
            message = kind()
            fill(message, random.Random(f'{kind.__name__} {seed}'))
            data = serialize_message(message)
            assert copied(message) == deserialize_message(data, kind), kind
            assert len(data) <= most_bytes(message), kind


def test_a_text_ends_where_c_ends_it_and_is_unicode() -> None:
    message = ParameterValue(string_value='a\0b', string_array_value=['\0', 'ä\0', 'c'])
    assert copied(message) == deserialize_message(serialize_message(message), ParameterValue)
    for wrong in ({'string_value': '\udc80'}, {'string_array_value': ['\udc80']}):
        for transport in (serialize_message, copied):
            with pytest.raises(UnicodeEncodeError):
                transport(ParameterValue(**wrong))
