# SPDX-License-Identifier: BSD-3-Clause
"""Typed values across process boundaries, without loss (``flexbt_msgs/msg/BlackboardEntry``).

A message is sent as CDR between programs, and as JSON for people, who may also write YAML. Both forms restore the same
value, bit for bit: floats are written with the digits that identify them, and not-a-number and the infinities have
names.

The names of types are resolved by :mod:`flexbt_common.values.value_types`.
"""

from __future__ import annotations

import struct
from collections.abc import Sequence
from enum import IntEnum
from typing import Any

from rclpy.serialization import serialize_message

from flexbt_common.errors import UnknownTypeError, ValueConversionError
from flexbt_core.values.text import short_repr
from flexbt_msgs.msg import BlackboardEntry

from .limits import deserialize
from .value_types import (
    FieldError,
    ValueType,
    exact,
    from_plain,
    parse_text,
    plain_text,
    resolve_type,
    to_plain,
    type_name,
)

_LENGTH = struct.Struct('<I')


class Encoding(IntEnum):
    """Form in which a value travels; the constants of BtExecute and BtGetData."""

    TEXT = 0
    BINARY = 1


def check_value(value: Any, type: str) -> Any:
    """Return ``value`` as a value of ``type``: a checked copy in the Python form that rclpy uses.

    A mapping is accepted for a message, and an int for a float, as in text.

    Raises:
        UnknownTypeError: the type is not known.
        ValueConversionError: the value does not fit the type.
    """
    resolved = resolve_type(type)
    try:
        return from_plain(to_plain(value, resolved), resolved)
    except FieldError as error:
        raise ValueConversionError('', resolved.name, short_repr(value), str(error)) from error


def to_entry(key: str, value: Any, type: str | None = None, encoding: Encoding = Encoding.BINARY) -> BlackboardEntry:
    """Write a value into an entry.

    ``type`` is the declared type; without one, the type of the Python value is used (:func:`type_name`).

    Raises:
        ValueConversionError: the value has no such type; names key, type and value.
    """
    try:
        resolved = resolve_type(type or type_name(value))
    except UnknownTypeError as error:
        raise ValueConversionError(key, type or '', short_repr(value), str(error)) from error
    entry = BlackboardEntry(key=key, type=resolved.name)
    try:
        plain = to_plain(value, resolved)
        if encoding is Encoding.BINARY and resolved.message is not None and plain != []:
            entry.data = _to_binary(value, plain, resolved)
        else:
            entry.text = plain_text(plain)
    except FieldError as error:
        raise ValueConversionError(key, resolved.name, short_repr(value), str(error)) from error
    return entry


def from_entry(entry: BlackboardEntry) -> Any:
    """Read the value of an entry.

    Raises:
        ValueConversionError: unknown type, malformed text or data; names key, type and text.
    """
    shown = entry.text if not entry.data else f'{len(entry.data)} bytes of data'
    try:
        resolved = resolve_type(entry.type)
        if not entry.data:
            if not entry.text and resolved.is_array and resolved.message is not None:
                return []  # the data of no elements
            return from_plain(parse_text(entry.text, resolved), resolved)
        if entry.text:
            raise FieldError('', 'both text and data are set; give one of them')
        if resolved.message is None:
            raise FieldError('', f'a value of type {resolved} is given as text, not as data')
        return _from_binary(bytes(entry.data), resolved)
    except (FieldError, UnknownTypeError) as error:
        raise ValueConversionError(entry.key, entry.type, shown, str(error)) from error


def value_to_text(value: Any, type: str | None = None) -> str:
    """Write a value as one line of JSON; :func:`text_to_value` gives back the same value.

    Raises:
        ValueConversionError: the value has no such type.
    """
    return str(to_entry('', value, type, Encoding.TEXT).text)


def text_to_value(text: str, type: str) -> Any:
    """Read a value from JSON or YAML text. Fields of a message that are left out keep their defaults.

    Raises:
        ValueConversionError: unknown type, malformed text, unknown field, or a value that does not fit.
    """
    return from_entry(BlackboardEntry(key='', type=type, text=text))


def _to_binary(value: Any, plain: Any, resolved: ValueType) -> bytes:
    # to_plain has checked every field: the C serializer aborts the process on some wrong ones.
    def cdr(message: Any, fields: Any) -> bytes:
        if not isinstance(message, resolved.message or object):
            message = from_plain(fields, resolve_type(resolved.name.removesuffix('[]')))
        return bytes(serialize_message(exact(message)))

    if not resolved.is_array:
        return cdr(value, plain)
    parts = []
    for message, fields in zip(value, plain, strict=True):
        data = cdr(message, fields)
        parts += [_LENGTH.pack(len(data)), data]
    return b''.join(parts)


def _from_binary(data: bytes, resolved: ValueType) -> Any:
    messages = [_from_cdr(part, resolved) for part in (_split(data) if resolved.is_array else [data])]
    return messages if resolved.is_array else messages[0]


def _from_cdr(data: bytes, resolved: ValueType) -> Any:
    try:
        return deserialize(data, resolved.message)
    except Exception as error:  # any exception of the middleware on malformed CDR
        raise FieldError('', f'{len(data)} bytes are not the CDR of a {resolved}: {error}') from error


def _split(data: bytes) -> Sequence[bytes]:
    parts: list[bytes] = []
    position = 0
    while position < len(data):
        if position + _LENGTH.size > len(data):
            raise FieldError(f'[{len(parts)}]', 'the data ends inside a length')
        (length,) = _LENGTH.unpack_from(data, position)
        position += _LENGTH.size
        if position + length > len(data):
            raise FieldError(f'[{len(parts)}]', f'the data ends inside an element of {length} bytes')
        parts.append(data[position : position + length])
        position += length
    return parts
