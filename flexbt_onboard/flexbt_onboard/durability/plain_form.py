# SPDX-License-Identifier: BSD-3-Clause
"""Values of userdata as JSON and back, exactly: numbers, texts, bytes, containers of them, and ROS messages.

Nothing is imported or called by what is read, apart from message types that are installed. A value that has no such
form is kept as the name of its type: reading it is an error that says what was lost.
"""

from __future__ import annotations

import base64
from collections.abc import Callable
from typing import Any, Final

from rclpy.serialization import deserialize_message, serialize_message

from flexbt_common.values import message_type_name, resolve_type
from flexbt_core.errors import FlexbtError
from flexbt_core.values import shown

_MARK: Final = '$'
"""An object with one key that begins with this is something else than a mapping with texts as keys."""

_MOST_DEPTH: Final = 64

_MOST_BITS: Final = 8192
"""Of an integer. Python refuses to read or write one of more than 4300 digits."""


def _ignore(_what: str) -> None:
    """Nobody wants to know what is lost."""


def to_plain_form(value: Any, on_lost: Callable[[str], object] = _ignore, depth: int = 0) -> Any:
    """What ``json.dumps`` takes. Never raises: of what cannot be written the type is noted, and ``on_lost`` told."""
    if value is None or type(value) in (bool, float, str):
        return value
    if type(value) is int:
        return value if value.bit_length() <= _MOST_BITS else _lost(value, on_lost)
    if depth > _MOST_DEPTH:
        return _lost(value, on_lost)
    if type(value) is list:
        return [to_plain_form(item, on_lost, depth + 1) for item in value]
    if type(value) is tuple:
        return {'$tuple': [to_plain_form(item, on_lost, depth + 1) for item in value]}
    if type(value) is dict:
        if all(type(key) is str and not key.startswith(_MARK) for key in value):
            return {key: to_plain_form(item, on_lost, depth + 1) for key, item in value.items()}
        return {'$map': [[to_plain_form(part, on_lost, depth + 1) for part in item] for item in value.items()]}
    if type(value) is bytes:
        return {'$bytes': base64.b64encode(value).decode()}
    if hasattr(type(value), 'get_fields_and_field_types'):
        try:
            data = base64.b64encode(bytes(serialize_message(value))).decode()
            return {'$message': [message_type_name(type(value)), data]}
        except Exception:  # fields of wrong types; whatever the middleware makes of them
            return _lost(value, on_lost)
    return _lost(value, on_lost)


def from_plain_form(value: Any, depth: int = 0) -> Any:
    """The value that was written.

    Raises:
        FlexbtError: it could not be written, or is nothing that :func:`to_plain_form` writes.
    """
    if depth > _MOST_DEPTH + 1:
        raise FlexbtError(f'{shown(value)} is no value that was written here: it is in {depth} others')

    def inner(item: Any) -> Any:
        return from_plain_form(item, depth + 1)

    if isinstance(value, list):
        return [inner(item) for item in value]
    if not isinstance(value, dict):
        return value
    mark = next(iter(value), '')
    if len(value) != 1 or not mark.startswith(_MARK):
        return {key: inner(item) for key, item in value.items()}
    content = value[mark]
    try:
        if mark == '$tuple':
            return tuple(inner(item) for item in content)
        if mark == '$map':
            return {inner(key): inner(item) for key, item in content}
        if mark == '$bytes':
            return base64.b64decode(content, validate=True)
        if mark == '$message':
            name, data = content
            return deserialize_message(base64.b64decode(data, validate=True), resolve_type(name).message)
    except FlexbtError:
        raise
    except Exception as error:
        raise FlexbtError(f'{shown(value)} is no value that was written here: {error}') from error
    if mark == '$lost':
        raise FlexbtError(f'a value of type {content} could not be written')
    raise FlexbtError(f'{shown(value)} is no value that was written here')


def _lost(value: Any, on_lost: Callable[[str], object]) -> dict[str, str]:
    name = f'{type(value).__module__}.{type(value).__qualname__}'
    on_lost(name)
    return {'$lost': name}
