# SPDX-License-Identifier: BSD-3-Clause
"""The types that a value may have when it crosses a process boundary, and how their names are resolved.

A type name is ``package/msg/Name`` of an installed message (``package/Name`` for short), one of the primitives
of the ROS interface language, or either with ``[]`` appended for an array of it.

Only interfaces that the ament index lists are ever imported: a name that arrives in a message selects among
what is installed, and can name nothing else.
"""

from __future__ import annotations

import functools
import importlib
import re
from array import array
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy
from ament_index_python.packages import get_packages_with_prefixes
from ament_index_python.resources import get_resource, get_resources
from rosidl_parser.definition import BasicType, UnboundedString

from flexbt_common.errors import UnknownTypeError
from flexbt_core.values import hint, shown

PRIMITIVES: Final[dict[str, Any]] = {
    'bool': BasicType('boolean'),
    'int8': BasicType('int8'),
    'uint8': BasicType('uint8'),
    'int16': BasicType('int16'),
    'uint16': BasicType('uint16'),
    'int32': BasicType('int32'),
    'uint32': BasicType('uint32'),
    'int64': BasicType('int64'),
    'uint64': BasicType('uint64'),
    'float32': BasicType('float'),
    'float64': BasicType('double'),
    'string': UnboundedString(),
}
"""The primitive types by name, as rosidl describes them."""

ALIASES: Final = {'int': 'int64', 'float': 'float64', 'double': 'float64', 'str': 'string', 'boolean': 'bool'}
"""Names that people write, and the primitive that they mean."""

_MESSAGE_NAME = re.compile(r'(?P<package>[a-z][a-z0-9_]*)/(?:msg/)?(?P<name>[A-Z][A-Za-z0-9]*)')


@dataclass(frozen=True)
class ValueType:
    """A type that a value can have.

    ``name`` is the canonical name, ``slot`` is rosidl's description of a primitive (None for a message),
    ``message`` is the message class (None for a primitive), ``is_array`` tells an array of it.
    """

    name: str
    slot: Any | None
    message: type[Any] | None
    is_array: bool

    def __str__(self) -> str:
        return self.name


def resolve_type(name: str) -> ValueType:
    """Find a type by its name.

    Raises:
        UnknownTypeError: no primitive and no installed message has that name.
    """
    return _resolved(name.strip())


@functools.cache  # of names that exist, with nothing around them: no more than there are types
def _resolved(name: str) -> ValueType:
    element = name
    is_array = element.endswith('[]')
    if is_array:
        element = element.removesuffix('[]')
    element = ALIASES.get(element, element)
    suffix = '[]' if is_array else ''
    if element in PRIMITIVES:
        return ValueType(element + suffix, PRIMITIVES[element], None, is_array)
    match = _MESSAGE_NAME.fullmatch(element)
    if match is None:
        raise UnknownTypeError(
            name,
            f'{name!r} is not a type name; expected package/msg/Name, or one of {", ".join(PRIMITIVES)}, '
            'with [] appended for an array',
        )
    package, short = match['package'], match['name']
    return ValueType(f'{package}/msg/{short}{suffix}', None, _message_class(name, package, short), is_array)


def message_type_name(message: type[Any]) -> str:
    """Name of a message class: ``package/msg/Name``."""
    package, kind, *_ = message.__module__.split('.')
    return f'{package}/{kind}/{message.__name__}'


def class_of_slot(slot: Any) -> type[Any]:
    """The class of the messages in a field that rosidl describes as a NamespacedType."""
    package, *_ = slot.namespaces
    message = resolve_type(f'{package}/msg/{slot.name}').message
    assert message is not None  # a NamespacedType is a message
    return message


def type_name(value: Any) -> str:
    """Name of the type with which a Python value is sent when nobody declared another.

    Python ints are int64, floats float64. An empty list has no type of its own.

    Raises:
        UnknownTypeError: no ROS type fits the value.
    """
    if isinstance(value, bool | numpy.bool_):
        return 'bool'
    if isinstance(value, int | numpy.integer):
        return 'int64'
    if isinstance(value, float | numpy.floating):
        return 'float64'
    if isinstance(value, str):
        return 'string'
    if hasattr(value, 'get_fields_and_field_types'):
        return message_type_name(type(value))
    if isinstance(value, bytes | bytearray):
        return 'uint8[]'
    if isinstance(value, array) and value.typecode != 'u':
        return f'{numpy.asarray(value).dtype}[]'
    if isinstance(value, numpy.ndarray) and value.ndim == 1 and str(value.dtype) in PRIMITIVES:
        return f'{value.dtype}[]'
    if isinstance(value, Sequence) and value:
        return _sequence_type_name(value)
    raise UnknownTypeError(
        type(value).__name__,
        f'no ROS type fits {shown(value)} of Python type {type(value).__name__}; declare its type',
    )


def _sequence_type_name(value: Sequence[Any]) -> str:
    names = {type_name(element) for element in value}
    if names == {'int64', 'float64'}:
        names = {'float64'}
    element, *others = sorted(names)
    if others or element.endswith('[]'):
        raise UnknownTypeError(
            type(value).__name__, f'no ROS type fits a list that mixes or nests {", ".join(sorted(names))}'
        )
    return element + '[]'


def _message_class(name: str, package: str, short: str) -> type[Any]:
    packages = get_resources('rosidl_interfaces')
    if package not in packages:
        remedy = (
            'it has no messages'
            if package in get_packages_with_prefixes()
            else 'install it, or source the workspace that has it'
        )
        remedy += hint(package, packages, '')
        raise UnknownTypeError(name, f'type {name!r}: no installed interface package {package!r}: {remedy}')
    messages = _messages_of(package)
    if short not in messages:
        near = hint(short, messages, '')
        raise UnknownTypeError(name, f'type {name!r}: package {package!r} has no message {short!r}{near}')
    message: type[Any] = getattr(importlib.import_module(f'{package}.msg'), short)
    return message


@functools.cache
def _messages_of(package: str) -> frozenset[str]:
    listing, _ = get_resource('rosidl_interfaces', package)
    lines = (line.strip() for line in listing.splitlines())
    return frozenset(
        line.removeprefix('msg/').rpartition('.')[0] for line in lines if line.startswith('msg/') and '.' in line
    )
