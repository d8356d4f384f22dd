# SPDX-License-Identifier: BSD-3-Clause
"""Values as plain data (dicts, lists, numbers, strings) and as text.

Plain data is the common form of both directions, and the place where every field is checked against its
declared type: rclpy's messages do not check, and the serializer aborts the process on some wrong types
(ROS 2 Jazzy, ``ROS_PYTHON_CHECK_FIELDS`` unset).
"""

from __future__ import annotations

import json
import math
import struct
from array import array
from collections.abc import Mapping, Sequence
from typing import Any, Final

import numpy
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
)

from flexbt_core.values import YamlError, hint, load_json, load_yaml, shown

from .value_types import ValueType, class_of_slot, resolve_type

_INTEGER_BITS = {'int8': 8, 'int16': 16, 'int32': 32, 'int64': 64}
_INTEGER_BITS |= {f'u{name}': bits for name, bits in _INTEGER_BITS.items()}
_ARRAY_CODES = {
    'int8': 'b', 'uint8': 'B', 'int16': 'h', 'uint16': 'H', 'int32': 'i', 'uint32': 'I',
    'int64': 'q', 'uint64': 'Q', 'float': 'f', 'double': 'd', 'char': 'B',
}  # fmt: skip
_NUMPY_TYPES = {'float': 'float32', 'double': 'float64', 'char': 'uint8'}
_FLOAT32_MAX = struct.unpack('<f', b'\xff\xff\x7f\x7f')[0]
_NAMED_FLOATS = {'nan': math.nan, '.nan': math.nan, 'inf': math.inf, '.inf': math.inf, 'infinity': math.inf}


MAX_YAML: Final = 100_000
"""Characters of YAML that are read: it takes more than a second for so many, a hundred times as long as JSON."""


class FieldError(ValueError):
    """A field that does not fit its type. ``path`` is where in the value, e.g. ``pose.position.x``."""

    def __init__(self, path: str, reason: str) -> None:
        super().__init__(f'field {path}: {reason}' if path else reason)
        self.path = path
        self.reason = reason


def plain_text(plain: Any) -> str:
    """Plain data as one line of JSON that is YAML as well; not-a-number and infinities by YAML's names."""
    return json.dumps(_name_floats(plain))


def parse_text(text: str, resolved: ValueType) -> Any:
    """Plain data from JSON or YAML. A string needs no quotes when it stands alone.

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
        raise FieldError('', f'the text is no JSON, and {len(text)} characters of YAML; at most {MAX_YAML} are read')
    try:
        return load_yaml(text)
    except YamlError as error:
        raise FieldError('', f'the text is no JSON, and {error.reason}') from error


def to_plain(value: Any, resolved: ValueType) -> Any:
    """Plain data of a value, checked.

    Raises:
        FieldError: the value does not have the type.
    """
    if resolved.is_array:
        element = resolve_type(resolved.name.removesuffix('[]'))
        if not _is_sequence(value):
            raise FieldError('', f'expected a list of {element}, got {shown(value)}')
        if element.slot is not None and isinstance(value, array | numpy.ndarray):
            value = value.tolist()
        return [_at(f'[{index}]', to_plain, item, element) for index, item in enumerate(value)]
    if resolved.message is None:
        return _plain_slot(_unwrap(value), resolved.slot, '')
    if isinstance(value, Mapping):  # the plain form itself
        value = _message_from_plain(value, resolved.message, '')
    if not isinstance(value, resolved.message):
        raise FieldError('', f'expected a {resolved}, got {type(value).__name__} {shown(value)}')
    return _plain_message(value, '')


def from_plain(plain: Any, resolved: ValueType) -> Any:
    """The value that plain data stands for, checked.

    Raises:
        FieldError: unknown field, or data that does not fit the type.
    """
    if resolved.is_array:
        element = resolve_type(resolved.name.removesuffix('[]'))
        if not isinstance(plain, list):
            raise FieldError('', f'expected a list of {element}, got {shown(plain)}')
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
    return isinstance(value, array | numpy.ndarray | bytes | bytearray) or (
        isinstance(value, Sequence) and not isinstance(value, str)
    )


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
            raise FieldError(path, f'expected a {expected.__name__}, got {shown(value)}')
        return _plain_message(value, path)
    if isinstance(slot, Array | AbstractSequence):
        if not _is_sequence(value):
            raise FieldError(path, f'expected a list, got {shown(value)}')
        _check_size(len(value), slot, path)
        elements = value.tolist() if isinstance(value, array | numpy.ndarray) else value
        return [_plain_slot(item, slot.value_type, f'{path}[{i}]') for i, item in enumerate(elements)]
    if _is_octet(slot) and isinstance(value, bytes) and len(value) == 1:
        return value[0]
    return _checked_scalar(_unwrap(value), slot, path)


# ---------------------------------------------------------------- plain -> message


def _message_from_plain(plain: Any, message: type[Any], path: str) -> Any:
    fields = message.get_fields_and_field_types()
    if plain is None:
        plain = {}
    if not isinstance(plain, Mapping):
        raise FieldError(path, f'expected the fields of a {message.__name__} ({", ".join(fields)}), got {shown(plain)}')
    for name in plain:
        if name not in fields:
            remedy = hint(name, fields, f'; its fields are {", ".join(fields) or "none"}')
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
            raise FieldError(path, f'expected a list, got {shown(plain)}')
        _check_size(len(plain), slot, path)
        items = [_value_of_slot(item, slot.value_type, f'{path}[{i}]') for i, item in enumerate(plain)]
        return _as_rclpy_list(items, slot)
    value = _checked_scalar(plain, slot, path)
    return bytes([value]) if _is_octet(slot) else value


def _as_rclpy_list(items: list[Any], slot: Any) -> Any:
    """The container in which rclpy's messages hold the elements of this slot."""
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
        raise FieldError(path, f'expected true or false, got {shown(value)}')
    if kind in ('float', 'double'):
        return _checked_float(value, kind, path)
    bits, signed = _INTEGER_BITS.get(kind, 8), kind.startswith('int')
    if isinstance(value, bool) or not isinstance(value, int):
        raise FieldError(path, f'expected an integer, got {shown(value)}')
    low, high = (-(1 << (bits - 1)), (1 << (bits - 1)) - 1) if signed else (0, (1 << bits) - 1)
    if not low <= value <= high:
        raise FieldError(path, f'{shown(value)} is outside {low} to {high}')
    return value


def _checked_float(value: Any, kind: str, path: str) -> float:
    if isinstance(value, str):  # YAML reads 1e5 as a string, and JSON has no not-a-number
        sign, name = (-1.0, value[1:]) if value.startswith('-') else (1.0, value)
        try:
            value = sign * (_NAMED_FLOATS[name.lower()] if name.lower() in _NAMED_FLOATS else float(name))
        except ValueError:
            raise FieldError(path, f'expected a number, got {shown(value)}') from None
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise FieldError(path, f'expected a number, got {shown(value)}')
    try:
        number = float(value)
    except OverflowError:
        raise FieldError(path, 'the number is too large') from None
    if kind == 'float' and math.isfinite(number) and abs(number) > _FLOAT32_MAX:
        raise FieldError(path, f'{number} is outside the range of float32')
    return number


def _checked_string(value: Any, slot: Any, path: str) -> str:
    if not isinstance(value, str):
        raise FieldError(path, f'expected a string, got {shown(value)}')
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
