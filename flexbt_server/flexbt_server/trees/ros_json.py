# SPDX-License-Identifier: BSD-3-Clause
"""ROS messages in the JSON of blackboards: any installed message, under its name."""

from __future__ import annotations

import functools
import json
from typing import Any

from flexbt_common.errors import UnknownTypeError
from flexbt_common.values import ValueType, message_type_name, resolve_type, text_to_value, value_to_text
from flexbt_core.behavior_tree import ConversionError, JsonObject, JsonTypes, PortType
from flexbt_core.errors import FlexbtError

from .ros_ports import message_type


class RosJsonTypes(JsonTypes):
    """Every message, and the classes of ``others``.

    The fields of a message are those of :func:`flexbt_common.values.entries.value_to_text`, which loses nothing.
    """

    def __init__(self, others: JsonTypes | None = None) -> None:
        super().__init__()
        self._others = others if others is not None else JsonTypes()

    def of_class(self, python_type: type[Any]) -> JsonObject | None:
        if hasattr(python_type, 'get_fields_and_field_types'):
            return _message(message_type_name(python_type))
        return super().of_class(python_type) or self._others.of_class(python_type)

    def of_name(self, name: str) -> JsonObject | None:
        resolved = _resolved(name)
        if resolved is not None and resolved.message is not None and not resolved.is_array:
            return _message(resolved.name)
        return super().of_name(name) or self._others.of_name(name)

    def port_type(self, name: str) -> PortType | None:
        known = super().port_type(name) or self._others.port_type(name)
        if known is None:
            resolved = _resolved(name)
            if resolved is not None and resolved.is_array:
                known = PortType(resolved.name, list)
        return known


def _resolved(name: str) -> ValueType | None:
    try:
        return resolve_type(name)
    except UnknownTypeError:
        return None


@functools.cache
def _message(name: str) -> JsonObject:
    message = resolve_type(name).message
    assert message is not None

    def to_json(value: Any) -> dict[str, Any]:
        try:
            fields: dict[str, Any] = json.loads(value_to_text(value, name))
        except FlexbtError as error:
            raise ConversionError(str(error)) from error
        return fields

    def from_json(fields: dict[str, Any]) -> Any:
        try:
            return text_to_value(json.dumps(fields), name)
        except FlexbtError as error:
            raise ConversionError(str(error)) from error

    return JsonObject(name, message_type(message), to_json, from_json)
