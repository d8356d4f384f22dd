# SPDX-License-Identifier: BSD-3-Clause
"""The types of values that cross a process boundary, and their form as plain data and as text.

A type name is ``package/msg/Name`` of an installed message (``package/Name`` for short), one of the primitives
of the ROS interface language, or either with ``[]`` appended for an array of it.

Only interfaces in the ament index are ever imported: a name in a message can select only an installed
interface.
"""

from __future__ import annotations

import functools
import importlib
import json
import math
import re
import struct
from array import array
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy
from ament_index_python.packages import get_packages_with_prefixes
from ament_index_python.resources import get_resource, get_resources
from rosidl_parser.definition import (
    AbstractSequence,
    AbstractString,
    AbstractWString,
    Array,
    BasicType,
    BoundedSequence,
    BoundedString,
    BoundedWString,
    NamespacedType,
    UnboundedString,
)

from flexbt_common.errors import UnknownTypeError
from flexbt_core.values.json_data import load_json
from flexbt_core.values.text import did_you_mean, short_repr
from flexbt_core.values.yaml_data import YamlError, load_yaml

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
"""Alternative names of primitives that people write."""

_MESSAGE_NAME = re.compile(r'(?P<package>[a-z][a-z0-9_]*)/(?:msg/)?(?P<name>[A-Z][A-Za-z0-9]*)')


@dataclass(frozen=True)
class ValueType:
    """A type that a value can have.

    ``name`` is the canonical name, ``slot`` is rosidl's description of a primitive (None for a message),
    ``message`` is the message class (None for a primitive), ``is_array`` is true for an array of it.
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
    message = interface_class(f'{match["package"]}/msg/{match["name"]}', 'msg')
    return ValueType(f'{message_type_name(message)}{suffix}', None, message, is_array)


def message_type_name(message: type[Any]) -> str:
    """Return the name of a message class: ``package/msg/Name``."""
    package, kind, *_ = message.__module__.split('.')
    return f'{package}/{kind}/{message.__name__}'


def class_of_slot(slot: Any) -> type[Any]:
    """Return the class of the messages in a field that rosidl describes as a NamespacedType."""
    package, *_ = slot.namespaces
    message = resolve_type(f'{package}/msg/{slot.name}').message
    assert message is not None  # a NamespacedType is a message
    return message


def type_name(value: Any) -> str:
    """Return the name of the type for sending a Python value without a declared type.

    Python ints are int64, floats float64. An empty list has no type.

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
        f'no ROS type fits {short_repr(value)} of Python type {type(value).__name__}; declare its type',
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


KINDS: Final = {'msg': 'message', 'srv': 'service', 'action': 'action'}
"""Kinds of interfaces, as they stand in names and as a person calls them."""


@functools.cache
def interface_names(kind: str) -> tuple[str, ...]:
    """Return the full names of all installed interfaces of a kind, sorted."""
    found = []
    for package in get_resources('rosidl_interfaces'):
        listing, _ = get_resource('rosidl_interfaces', package)
        for line in map(str.strip, listing.splitlines()):
            name, dot, suffix = line.rpartition('.')
            if dot and name.startswith(f'{kind}/') and (suffix == kind or kind == 'msg'):
                found.append(f'{package}/{name}')
    return tuple(sorted(set(found)))


def interface_class(name: str, kind: str) -> type[Any]:
    """Return the class of an installed interface by its name, ``package/action/Name`` or ``package/Name``.

    Only what the ament index lists is imported.

    Raises:
        UnknownTypeError: no such interface is installed.
    """
    package, *rest = name.strip().split('/')
    full = '/'.join((package, kind, *rest) if len(rest) == 1 else (package, *rest))
    if full not in interface_names(kind):
        raise UnknownTypeError(name, f'type {name!r}: {_why_unknown(full, kind)}')
    found: type[Any] = getattr(importlib.import_module(f'{package}.{kind}'), rest[-1])
    return found


def _why_unknown(name: str, kind: str) -> str:
    package, *rest = name.split('/')
    if len(rest) != 2 or rest[0] != kind:
        return f'this is not the name of a type of {KINDS[kind]}s; write package/{kind}/Name'
    short = rest[1]
    known = [one.split('/') for one in interface_names(kind)]
    packages = {one[0] for one in known}
    if package in packages:
        near = did_you_mean(short, [one[2] for one in known if one[0] == package], '')
        return f'package {package!r} has no {KINDS[kind]} {short!r}{near}'
    if package in get_packages_with_prefixes():
        return f'package {package!r} has no {KINDS[kind]}s'
    near = did_you_mean(package, packages, '')
    return f'package {package!r} is not installed: install it, or source the workspace that has it{near}'


# Values as plain data (dicts, lists, numbers, strings) and as text.
#
# Plain data is the common form of both directions, and the place where every field is checked against its
# declared type: rclpy's messages do not check, and the serializer aborts the process on some wrong types
# (ROS 2 Jazzy, ``ROS_PYTHON_CHECK_FIELDS`` unset).

_INTEGER_BITS = {'int8': 8, 'int16': 16, 'int32': 32, 'int64': 64}
_INTEGER_BITS |= {f'u{name}': bits for name, bits in _INTEGER_BITS.items()}
_ARRAY_CODES = {
    'int8': 'b', 'uint8': 'B', 'int16': 'h', 'uint16': 'H', 'int32': 'i', 'uint32': 'I',
    'int64': 'q', 'uint64': 'Q', 'float': 'f', 'double': 'd', 'char': 'B',
}  # fmt: skip
_NUMPY_TYPES = {'float': 'float32', 'double': 'float64', 'char': 'uint8'}
_FLOAT32_MAX = struct.unpack('<f', b'\xff\xff\x7f\x7f')[0]
_NAMED_FLOATS = {'.nan': math.nan, '.inf': math.inf, '+.inf': math.inf, '-.inf': -math.inf}
"""Names of YAML that Python's ``float`` does not know."""


MAX_YAML: Final = 100_000
"""Maximum number of characters of YAML that are read: they take more than a second, a hundred times as long as JSON."""


class FieldError(ValueError):
    """A field that does not fit its type. ``path`` is where in the value, e.g. ``pose.position.x``."""

    def __init__(self, path: str, reason: str) -> None:
        super().__init__(f'field {path}: {reason}' if path else reason)
        self.path = path
        self.reason = reason


def plain_text(plain: Any) -> str:
    """Return plain data as one line of JSON that is also YAML; not-a-number and infinities have YAML's names."""
    return json.dumps(_name_floats(plain))


def parse_text(text: str, resolved: ValueType) -> Any:
    """Return plain data from JSON or YAML. A single string needs no quotes.

    Raises:
        FieldError: the text is neither JSON nor YAML.
    """
    is_string = resolved.name == 'string'
    try:
        plain = load_json(text)
        if not is_string or isinstance(plain, str):
            return plain
    except (ValueError, RecursionError):
        if is_string and not text.startswith('"'):
            return text
    if is_string:
        return text
    if len(text) > MAX_YAML:
        raise FieldError('', f'the text is not JSON, and {len(text)} characters of YAML; at most {MAX_YAML} are read')
    try:
        return load_yaml(text)
    except YamlError as error:
        raise FieldError('', f'the text is not JSON, and {error.reason}') from error


def to_plain(value: Any, resolved: ValueType) -> Any:
    """Return the plain data of a value, checked.

    Raises:
        FieldError: the value does not have the type.
    """
    if resolved.is_array:
        element = resolve_type(resolved.name.removesuffix('[]'))
        if not _is_sequence(value):
            raise FieldError('', f'expected a list of {element}, got {short_repr(value)}')
        if element.slot is not None and isinstance(value, array | numpy.ndarray):
            value = value.tolist()
        return [_at(f'[{index}]', to_plain, item, element) for index, item in enumerate(value)]
    if resolved.message is None:
        return _plain_slot(_unwrap(value), resolved.slot, '')
    if isinstance(value, Mapping):  # the plain form itself
        value = _message_from_plain(value, resolved.message, '')
    if not isinstance(value, resolved.message):
        raise FieldError('', f'expected a {resolved}, got {type(value).__name__} {short_repr(value)}')
    return _plain_message(value, '')


def from_plain(plain: Any, resolved: ValueType) -> Any:
    """Return the value that plain data stands for, checked.

    Raises:
        FieldError: unknown field, or data that does not fit the type.
    """
    if resolved.is_array:
        element = resolve_type(resolved.name.removesuffix('[]'))
        if not isinstance(plain, list):
            raise FieldError('', f'expected a list of {element}, got {short_repr(plain)}')
        return [_at(f'[{index}]', from_plain, item, element) for index, item in enumerate(plain)]
    if resolved.message is None:
        return _value_of_slot(plain, resolved.slot, '')
    return _message_from_plain(plain, resolved.message, '')


def _at(place: str, function: Any, *arguments: Any) -> Any:
    try:
        return function(*arguments)
    except FieldError as error:
        raise FieldError(_join(place, error.path), error.reason) from error


def _join(parent: str, child: str) -> str:
    return f'{parent}.{child}' if parent and child and not child.startswith('[') else parent + child


def _is_sequence(value: Any) -> bool:
    if isinstance(value, numpy.ndarray):
        return value.ndim == 1
    return isinstance(value, array | bytes | bytearray) or (isinstance(value, Sequence) and not isinstance(value, str))


def _unwrap(value: Any) -> Any:
    return value.item() if isinstance(value, numpy.generic) else value


# ---------------------------------------------------------------- message -> plain


def _plain_message(message: Any, path: str) -> dict[str, Any]:
    names = message.get_fields_and_field_types()
    return {
        name: _plain_slot(getattr(message, name), slot, _join(path, name))
        for name, slot in zip(names, message.SLOT_TYPES, strict=True)
    }


def _plain_slot(value: Any, slot: Any, path: str) -> Any:
    if isinstance(slot, NamespacedType):
        expected = class_of_slot(slot)
        if not isinstance(value, expected):
            raise FieldError(path, f'expected a {expected.__name__}, got {short_repr(value)}')
        return _plain_message(value, path)
    if isinstance(slot, Array | AbstractSequence):
        if not _is_sequence(value):
            raise FieldError(path, f'expected a list, got {short_repr(value)}')
        _check_size(len(value), slot, path)
        elements = value.tolist() if isinstance(value, array | numpy.ndarray) else value
        if isinstance(value, array) and value.typecode == _ARRAY_CODES.get(getattr(slot.value_type, 'typename', '')):
            return elements  # they can be nothing else; one by one, those of a map take more than a second
        return [_plain_slot(item, slot.value_type, f'{path}[{i}]') for i, item in enumerate(elements)]
    if _is_octet(slot) and isinstance(value, bytes) and len(value) == 1:
        return value[0]
    return _checked_scalar(_unwrap(value), slot, path)


# ---------------------------------------------------------------- fields as the serializer reads them
#
# rclpy's messages take any value in any field. Where it is none of these classes, the serializer sends other memory
# (5e-324 for an int 1 in a field of floats, False for numpy's True), raises SystemError (numpy's integers) or aborts.
# Of an integer that is too large, it sends the lowest bits.

_READ_AS: Final[dict[str, type]] = {'float': float, 'double': float, 'boolean': bool, 'octet': bytes}


def exact(message: Any) -> Any:
    """Return a message that is sent as its fields show: itself, or a checked copy if a field holds a number, bool or
    byte of another class. Use this for messages that code of users has made.

    Raises:
        FieldError: a field does not fit its type.
    """
    kind: Any = type(message)
    is_exact = _exactness(kind)(message)
    return message if is_exact else _message_from_plain(_plain_message(message, ''), kind, '')


@functools.cache
def _exactness(message: Any) -> Callable[[Any], bool]:
    """Return the check of the messages of a type. It is compiled, to take less time than sending what it checks."""
    names: dict[str, Any] = {}
    fields = zip(message.get_fields_and_field_types(), message.SLOT_TYPES, strict=True)
    tests = [test for name, slot in fields for test in _tests(f'message._{name}', slot, names)]
    check: Callable[[Any], bool] = eval(f'lambda message: {" and ".join(tests) or True}', names)  # noqa: S307 - own text
    return check


def _tests(value: str, slot: Any, names: dict[str, Any]) -> Iterator[str]:
    """Yield expressions that are true if ``value``, an expression too, is what the serializer reads in a field, as far
    as it does not check that itself. Add what they use to ``names``."""
    if isinstance(slot, NamespacedType):
        kind: Any = class_of_slot(slot)
        number = len(names)  # types of two packages may have one name
        names |= {f'kind_{number}': kind, f'is_exact_{number}': _exactness(kind)}
        yield f'isinstance({value}, kind_{number}) and is_exact_{number}({value})'
    elif isinstance(slot, Array | AbstractSequence):
        if isinstance(slot, Array):
            yield f'len({value}) == {slot.size}'
        if not isinstance(slot.value_type, BasicType) or slot.value_type.typename not in _ARRAY_CODES:
            for test in _tests('element', slot.value_type, names):
                yield f'all({test} for element in {value})'
    elif isinstance(slot, BasicType):
        read = _READ_AS.get(slot.typename, int)
        yield f'isinstance({value}, {read.__name__})'
        if read is int:
            low, high = _integer_range(slot.typename)
            yield f'{low} <= {value} <= {high}'


# ---------------------------------------------------------------- plain -> message


def _message_from_plain(plain: Any, message: type[Any], path: str) -> Any:
    fields = message.get_fields_and_field_types()
    if plain is None:
        plain = {}
    if not isinstance(plain, Mapping):
        raise FieldError(
            path, f'expected the fields of a {message.__name__} ({", ".join(fields)}), got {short_repr(plain)}'
        )
    for name in plain:
        if name not in fields:
            remedy = did_you_mean(name, fields, f'; its fields are {", ".join(fields) or "none"}')
            raise FieldError(_join(path, str(name)), f'{message.__name__} has no such field{remedy}')
    return message(
        **{
            name: _value_of_slot(plain[name], slot, _join(path, name))
            for name, slot in zip(fields, message.SLOT_TYPES, strict=True)
            if name in plain
        }
    )


def _value_of_slot(plain: Any, slot: Any, path: str) -> Any:
    if isinstance(slot, NamespacedType):
        return _message_from_plain(plain, class_of_slot(slot), path)
    if isinstance(slot, Array | AbstractSequence):
        if not isinstance(plain, list):
            raise FieldError(path, f'expected a list, got {short_repr(plain)}')
        _check_size(len(plain), slot, path)
        items = [_value_of_slot(item, slot.value_type, f'{path}[{i}]') for i, item in enumerate(plain)]
        return _as_rclpy_list(items, slot)
    value = _checked_scalar(plain, slot, path)
    return bytes([value]) if _is_octet(slot) else value


def slot_value(value: Any, slot: Any, path: str) -> Any:
    """Return a value as a message holds it in a field of this ``slot``, checked. Messages that are :func:`exact` are
    not copied.

    Plain data stands for a message, and an int for a float.

    Raises:
        FieldError: the value does not fit; it names ``path``.
    """
    if isinstance(slot, NamespacedType):
        expected = class_of_slot(slot)
        if isinstance(value, expected):
            return _at(path, exact, value)
        if isinstance(value, Mapping):
            return _message_from_plain(value, expected, path)
        raise FieldError(path, f'expected a {expected.__name__}, got {short_repr(value)}')
    if isinstance(slot, Array | AbstractSequence) and isinstance(slot.value_type, NamespacedType):
        if not _is_sequence(value):
            raise FieldError(path, f'expected a list, got {short_repr(value)}')
        _check_size(len(value), slot, path)
        return [slot_value(item, slot.value_type, f'{path}[{i}]') for i, item in enumerate(value)]
    return _value_of_slot(_plain_slot(_unwrap(value), slot, path), slot, path)


def slot_type_name(slot: Any) -> str:
    """Return the name of the type of a field, as :func:`resolve_type` takes it; arrays of any kind end with ``[]``."""
    if isinstance(slot, Array | AbstractSequence):
        return f'{slot_type_name(slot.value_type)}[]'
    if isinstance(slot, NamespacedType):
        return message_type_name(class_of_slot(slot))
    if isinstance(slot, AbstractString | AbstractWString):
        return 'string'
    return _PRIMITIVE_OF_SLOT.get(slot.typename, 'uint8')  # char and octet are bytes


_PRIMITIVE_OF_SLOT: Final = {slot.typename: name for name, slot in PRIMITIVES.items() if isinstance(slot, BasicType)}


def _as_rclpy_list(items: list[Any], slot: Any) -> Any:
    """Return the container in which rclpy's messages hold the elements of this slot."""
    element = slot.value_type.typename if isinstance(slot.value_type, BasicType) else ''
    if element not in _ARRAY_CODES:
        return items
    if isinstance(slot, Array):
        return numpy.array(items, dtype=_NUMPY_TYPES.get(element, element))
    return array(_ARRAY_CODES[element], items)


def _checked_scalar(value: Any, slot: Any, path: str) -> Any:
    if isinstance(slot, AbstractString | AbstractWString):
        return _checked_string(value, slot, path)
    kind = slot.typename
    if kind == 'boolean':
        if isinstance(value, bool):
            return value
        raise FieldError(path, f'expected true or false, got {short_repr(value)}')
    if kind in ('float', 'double'):
        return _checked_float(value, kind, path)
    if isinstance(value, bool) or not isinstance(value, int):
        raise FieldError(path, f'expected an integer, got {short_repr(value)}')
    low, high = _integer_range(kind)
    if not low <= value <= high:
        raise FieldError(path, f'{short_repr(value)} is outside {low} to {high}')
    return value


def _integer_range(kind: str) -> tuple[int, int]:
    bits = _INTEGER_BITS.get(kind, 8)  # char and octet are bytes
    return (-(1 << (bits - 1)), (1 << (bits - 1)) - 1) if kind.startswith('int') else (0, (1 << bits) - 1)


def _checked_float(value: Any, kind: str, path: str) -> float:
    if isinstance(value, str):  # YAML reads 1e5 as a string, and JSON has no not-a-number
        name = value.lower()
        try:
            value = _NAMED_FLOATS[name] if name in _NAMED_FLOATS else float(name)
        except ValueError:
            raise FieldError(path, f'expected a number, got {short_repr(value)}') from None
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise FieldError(path, f'expected a number, got {short_repr(value)}')
    try:
        number = float(value)
    except OverflowError:
        raise FieldError(path, 'the number is too large') from None
    if kind == 'float' and math.isfinite(number) and abs(number) > _FLOAT32_MAX:
        raise FieldError(path, f'{number} is outside the range of float32')
    return number


def _checked_string(value: Any, slot: Any, path: str) -> str:
    if not isinstance(value, str):
        raise FieldError(path, f'expected a string, got {short_repr(value)}')
    if isinstance(slot, BoundedString | BoundedWString) and len(value) > slot.maximum_size:
        raise FieldError(path, f'{len(value)} characters, at most {slot.maximum_size} are allowed')
    if path and '\0' in value:
        raise FieldError(path, 'a string of a message cannot hold a NUL character: ROS 2 would cut it there')
    try:
        value.encode()
    except UnicodeEncodeError as error:
        raise FieldError(path, f'not a Unicode text: {error.reason}') from error
    return value


def _check_size(size: int, slot: Any, path: str) -> None:
    if isinstance(slot, Array) and size != slot.size:
        raise FieldError(path, f'{size} elements, exactly {slot.size} are needed')
    if isinstance(slot, BoundedSequence) and size > slot.maximum_size:
        raise FieldError(path, f'{size} elements, at most {slot.maximum_size} are allowed')


def _is_octet(slot: Any) -> bool:
    return isinstance(slot, BasicType) and slot.typename == 'octet'


def _name_floats(plain: Any) -> Any:
    if isinstance(plain, float) and not math.isfinite(plain):
        return '.nan' if math.isnan(plain) else ('.inf' if plain > 0 else '-.inf')
    if isinstance(plain, dict):
        return {key: _name_floats(item) for key, item in plain.items()}
    if isinstance(plain, list):
        return [_name_floats(item) for item in plain]
    return plain
