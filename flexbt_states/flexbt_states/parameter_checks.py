# SPDX-License-Identifier: BSD-3-Clause
"""Checks of the parameters of states. They refuse unusable values while the behavior is built."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Any

from rclpy.exceptions import InvalidTopicNameException
from rclpy.validate_topic_name import validate_topic_name

from flexbt_common.errors import ResourceError, UnknownTypeError
from flexbt_common.files import resolve_file
from flexbt_common.values.value_types import interface_class, resolve_type
from flexbt_core.values.text import short_repr

from .errors import StateParameterError


def checked_text(state: object, parameter: str, text: str) -> str:
    """Return a text. A message with anything else in its place would end the process that sends it."""
    if not isinstance(text, str):
        raise StateParameterError(state, parameter, f'{short_repr(text)} is not text; in YAML, quote it')
    return text


def checked_list(state: object, parameter: str, given: Iterable[Any], of: str) -> list[Any]:
    """Return a list; ``of`` is what its entries are. A text is none, nor is a mapping."""
    if isinstance(given, str | Mapping) or not isinstance(given, Iterable):
        raise StateParameterError(state, parameter, f'{short_repr(given)} is not a list of {of}')
    return list(given)


def checked_mapping(state: object, parameter: str, given: Mapping[str, Any] | None) -> Mapping[str, Any]:
    """Return a mapping; an empty one for None."""
    if given is not None and not isinstance(given, Mapping):
        raise StateParameterError(state, parameter, f'{short_repr(given)} is not a mapping, as in {{name: value}}')
    return given or {}


def checked_topic(state: object, parameter: str, name: str) -> str:
    """Return the name of a topic or an action, relative or absolute."""
    try:
        validate_topic_name(checked_text(state, parameter, name))
    except InvalidTopicNameException as error:
        raise StateParameterError(state, parameter, f'{name!r} is not a ROS name: {error}') from None
    return name


def checked_type(state: object, parameter: str, name: str, package: str = '') -> str:
    """Return the canonical name of an installed type. ``package`` completes a bare message name, as in FlexBE's
    states."""
    checked_text(state, parameter, name)
    full = f'{package}/msg/{name}' if package and name and '/' not in name else name
    try:
        return resolve_type(full).name
    except UnknownTypeError as error:
        raise StateParameterError(state, parameter, str(error)) from None


def checked_message_type(state: object, parameter: str, message: str | type[Any]) -> type[Any]:
    """Return the message class of a topic, by class or by name."""
    if isinstance(message, type) and hasattr(message, 'get_fields_and_field_types'):
        return message
    if not isinstance(message, str):
        raise StateParameterError(state, parameter, f'{message!r} is neither a message class nor the name of one')
    name = checked_type(state, parameter, message)
    resolved = resolve_type(name)
    if resolved.message is None or resolved.is_array:
        raise StateParameterError(state, parameter, f'{name} is not a message; a topic carries package/msg/Name')
    return resolved.message


def checked_action_type(state: object, parameter: str, action: str | type[Any]) -> type[Any]:
    """Return the class of an action, by class or by name, as in nav2_msgs/action/FollowPath."""
    if isinstance(action, type) and hasattr(action, 'Goal'):
        return action
    try:
        return interface_class(str(action), 'action')
    except UnknownTypeError as error:
        raise StateParameterError(state, parameter, str(error)) from None


def checked_types(state: object, parameter: str, types: Mapping[str, str] | None) -> dict[str, str]:
    """Return the types by blackboard key."""
    checked = {}
    for key, name in checked_mapping(state, parameter, types).items():
        if not checked_text(state, parameter, key):
            raise StateParameterError(state, parameter, 'a key is empty')
        checked[key] = checked_type(state, f'{parameter}[{key!r}]', name)
    return checked


def checked_timeout(state: object, parameter: str, seconds: float | None) -> float | None:
    """Return a limit in s; None for no limit."""
    if seconds is None:
        return None
    if not is_number(seconds) or seconds <= 0:
        raise StateParameterError(state, parameter, f'{short_repr(seconds)} is not a positive number of seconds')
    return float(seconds)


def is_number(value: object) -> bool:
    """Return whether a value is a finite number, and no bool, which is an int in Python."""
    return isinstance(value, int | float) and not isinstance(value, bool) and abs(value) <= sys.float_info.max


def checked_file(state: object, parameter: str, name: str) -> str:
    """Return the name of an existing tree file. The BT server decides whether its directory is allowed."""
    try:
        resolve_file(checked_text(state, parameter, name), allowed=[Path('/')])
    except ResourceError as error:
        raise StateParameterError(state, parameter, str(error)) from None
    return name


def checked_tree(state: object, parameter: str, name: str) -> str:
    """Return a tree's identifier, or the name of an existing file; empty for the server's default tree."""
    checked_text(state, parameter, name)
    return checked_file(state, parameter, name) if name.endswith('.xml') or '/' in name else name


def checked_outcomes(state: object, parameter: str, outcomes: Iterable[str]) -> list[str]:
    """Return the outcomes to choose from: at least one, without duplicates."""
    names = checked_list(state, parameter, outcomes, 'outcomes')
    if not names:
        raise StateParameterError(state, parameter, 'the list is empty')
    for name in names:
        if not isinstance(name, str):  # YAML reads on, off, yes and no as booleans
            raise StateParameterError(state, parameter, f'{name!r} is not text; in YAML, quote an outcome such as on')
    if len(set(names)) < len(names):
        raise StateParameterError(state, parameter, f'an outcome is listed twice: {", ".join(names)}')
    return names


def checked_keys(state: object, parameter: str, keys: Iterable[str]) -> list[str]:
    """Return userdata keys without duplicates."""
    names = checked_list(state, parameter, keys, 'userdata keys')
    for name in names:
        if not isinstance(name, str) or not name:
            raise StateParameterError(state, parameter, f'{name!r} is not a userdata key')
    return list(dict.fromkeys(names))


def checked_callable(state: object, parameter: str, function: Any) -> Callable[..., Any]:
    """Return a function. Refuses text, which is not evaluated."""
    if not callable(function):
        hint = '; text is not evaluated, write a lambda' if isinstance(function, str) else ''
        raise StateParameterError(state, parameter, f'{short_repr(function)} cannot be called{hint}')
    return function
