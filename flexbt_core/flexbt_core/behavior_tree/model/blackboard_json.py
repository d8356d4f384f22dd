# SPDX-License-Identifier: BSD-3-Clause
"""Blackboards as JSON: in the form of BehaviorTree.CPP, and as an export that can be imported again.

A document is an object with one item for each entry. Text, numbers, true and false are written as they are; their
entries have no fixed type, as if a script had made them. Lists are written as lists, for entries of list types. Any
other value is an object with the name of its type, as in BehaviorTree.CPP; it fixes the type of the entry::

    {"speed": 0.5, "goal": {"__type": "geometry_msgs/msg/PoseStamped", "header": {...}, "pose": {...}}}

An entry with a different type is ``{"type": "double", "value": 0.5}``, without ``value`` if it was declared but never
written. An entry with neither type nor value is null.
"""

from __future__ import annotations

import json
import math
from collections import deque
from collections.abc import Callable, Mapping
from enum import Enum
from typing import Any, Final, NamedTuple, TypeVar

from . import ports
from .blackboard import EMPTY, Blackboard, Entry
from .errors import BlackboardError, ConversionError
from .ports import PortType, cast, is_fixed, list_of, type_of
from .status import NodeStatus

TYPE_FIELD: Final = '__type'
UNTYPED: Final = 'BT::AnyTypeAllowed'
"""Name that BehaviorTree.CPP gives to the type of an entry before it is fixed."""

_MAX_DEPTH: Final = 100
_SCALARS: Final = {
    kind.name: kind
    for kind in vars(ports).values()
    if isinstance(kind, PortType) and kind not in (ports.KEY, ports.KEYS)
}
_BUILTIN_VALUES: Final = {
    kind.__qualname__: PortType(kind.__qualname__, kind) for kind in (list, tuple, dict, deque, type(None))
}
_FLOATS: Final = {'nan': math.nan, 'inf': math.inf, '-inf': -math.inf}
_Object = TypeVar('_Object')


class JsonObject(NamedTuple):
    """The JSON form of a class: its name, its type on a blackboard, and the two conversions.

    The conversions work on JSON data. ``from_json`` raises ConversionError, ValueError, TypeError or LookupError.
    """

    name: str
    type: PortType
    to_json: Callable[[Any], dict[str, Any]]
    from_json: Callable[[dict[str, Any]], Any]


class JsonTypes:
    """The classes whose objects JSON may hold. A name in a document can only select one of these classes.

    To add families of classes, derive from it and override :meth:`of_class`, :meth:`of_name` and :meth:`port_type`.
    """

    def __init__(self) -> None:
        self._by_class: dict[type[Any], JsonObject] = {}
        self._by_name: dict[str, JsonObject] = {}

    def register(
        self,
        name: str,
        python_type: type[_Object],
        to_json: Callable[[_Object], dict[str, Any]],
        from_json: Callable[[dict[str, Any]], _Object],
    ) -> None:
        """Register a class. Raises ValueError if its name or the class is already registered."""
        if name in self._by_name or python_type in self._by_class or name in _BUILTIN_VALUES:
            raise ValueError(f'the JSON type {name!r}, or its class {python_type.__qualname__}, is registered already')
        entry = JsonObject(name, PortType(python_type.__qualname__, python_type), to_json, from_json)
        self._by_name[name] = self._by_class[python_type] = entry

    def of_class(self, python_type: type[Any]) -> JsonObject | None:
        return self._by_class.get(python_type)

    def of_name(self, name: str) -> JsonObject | None:
        return self._by_name.get(name)

    def port_type(self, name: str) -> PortType | None:
        """Return the entry type of this name; None if it is unknown."""
        known = _SCALARS.get(name)
        if known is None and name.startswith('std::vector<') and name.endswith('>'):
            element = self.port_type(name.removeprefix('std::vector<')[:-1])
            known = None if element is None else list_of(element)
        if known is None:
            known = _BUILTIN_VALUES.get(name)
        if known is None:
            registered = self.of_name(name) or next((o for o in self._by_name.values() if o.type.name == name), None)
            known = None if registered is None else registered.type
        return known


# -- as BehaviorTree.CPP shows it --------------------------------------------------------------------------------------


def show_blackboard(board: Blackboard, types: JsonTypes) -> dict[str, Any]:
    """Return the entries of this scope as BehaviorTree.CPP exports them, for its tools.

    A bool is the integer 0 or 1. NaN and the infinities are floats. An entry that was never written, or has no JSON
    form, is None.
    """
    return {key: _shown(value, types) for key, _, value in _entries(board)}


def _shown(value: Any, types: JsonTypes) -> Any:
    if isinstance(value, str):
        return value
    if isinstance(value, int):
        return int(value)
    if isinstance(value, float):
        return float(value)
    try:
        return _encode(value, types, 0)
    except ConversionError:
        return None


# -- without loss ------------------------------------------------------------------------------------------------------


def export_blackboard(board: Blackboard, types: JsonTypes) -> tuple[dict[str, Any], list[str]]:
    """Return the typed entries of this scope at one moment, and the reasons why entries without JSON form are missing.

    :func:`import_blackboard` restores them. The document contains only values that ``json`` writes and reads without
    loss.
    """
    document: dict[str, Any] = {}
    problems: list[str] = []
    for key, kind, value in _entries(board):
        try:
            document[key] = _encode_entry(kind, value, types)
        except ConversionError as error:
            problems.append(f'entry [{key}]: {error}')
    return document, problems


def import_blackboard(board: Blackboard, document: Mapping[str, Any], types: JsonTypes) -> None:
    """Write all entries of a document, or none of them. Other entries do not change.

    A new entry gets the type and the value of the document. An entry that has a type accepts the value as in
    :meth:`Blackboard.set`, if it converts without loss. (BehaviorTree.CPP overwrites an entry of any type, and does not
    count that as a write.)

    Raises:
        BlackboardError: names every entry that is not understood, or the one that does not fit.
    """
    with board.lock:
        writes: list[tuple[Blackboard, str, PortType | None, Any]] = []
        problems: list[str] = []
        for key, item in document.items():
            try:
                writes.append((*board.outermost(key), *_decode_entry(item, types, board.entry(key))))
            except ConversionError as error:
                problems.append(f'entry [{key}]: {error}')
        if problems:
            raise BlackboardError('; '.join(problems))
        # Write to copies with the same types first: if they accept all values, the scopes of the entries do too.
        rehearsals: dict[Blackboard, Blackboard] = {}
        for scope, key, kind, value in writes:
            rehearsal = rehearsals.setdefault(scope, Blackboard())
            entry = scope.entry(key)
            if entry is not None and key not in rehearsal:
                rehearsal.declare(key, entry.type).value = entry.value
            _write(rehearsal, key, kind, value)
        for scope, key, kind, value in writes:
            _write(scope, key, kind, value)


def _entries(board: Blackboard) -> list[tuple[str, PortType | None, Any]]:
    with board.lock:
        found = ((key, board.entry(key)) for key in board)
        return [(key, entry.type, entry.value) for key, entry in found if entry is not None]


def _write(board: Blackboard, key: str, kind: PortType | None, value: Any) -> None:
    entry = board.entry(key)
    if entry is not None and is_fixed(entry.type):
        if value is not EMPTY:
            board.set(key, value, kind)
        return
    entry = board.declare(key, kind)
    if kind is not None:
        entry.type = kind
    if value is not EMPTY:
        entry.write(value)


# -- entries -----------------------------------------------------------------------------------------------------------


def _encode_entry(kind: PortType | None, value: Any, types: JsonTypes) -> Any:
    if value is EMPTY:
        return None if kind is None else {'type': kind.name}
    encoded = _encode(value, types, 0)
    _check_fit(value, kind)
    if value is not None and _is_told(kind, value, types):
        return encoded
    return {'type': UNTYPED if kind is None else kind.name, 'value': encoded}


def _is_told(kind: PortType | None, value: Any, types: JsonTypes) -> bool:
    """Return whether the value alone implies this type of its entry."""
    told = _natural_type(value, types)
    if kind is None or told is None:
        return kind is told
    return kind.name == told.name or (types.of_class(value.__class__) is not None and kind.same(told))


def _natural_type(value: Any, types: JsonTypes) -> PortType | None:
    """Return the type of a new entry for a value without further information."""
    if isinstance(value, str | int | float) and not isinstance(value, Enum):
        return None
    known = types.of_class(value.__class__)
    return type_of(value) if known is None else known.type


def _decode_entry(item: Any, types: JsonTypes, present: Entry | None) -> tuple[PortType | None, Any]:
    if item is None:
        return None, EMPTY
    if not isinstance(item, dict) or TYPE_FIELD in item:
        value = _decode(item, types, 0)
        return _natural_type(value, types), value
    name = item.get('type')
    if not isinstance(name, str) or not item.keys() <= {'type', 'value'}:
        raise ConversionError(
            f'an object has to have {TYPE_FIELD!r} beside its fields, or only "type" and "value"; this one has '
            f'{", ".join(map(repr, item)) or "nothing"}'
        )
    # A user's type is known only if a tree that uses it has created the entry.
    known = present.type if present is not None and present.type is not None and present.type.name == name else None
    kind = known or types.port_type(name)
    if kind is None and name != UNTYPED:
        raise ConversionError(f'the type {name!r} is not known')
    if 'value' not in item:
        return kind, EMPTY
    value = _decode(item['value'], types, 0)
    _check_fit(value, kind)
    return kind, value


def _check_fit(value: Any, kind: PortType | None) -> None:
    """Check that an entry of this type may hold a value. Raises ConversionError, such as for an integer that a script
    has assigned to an entry of smaller ones."""
    if kind is not None and not isinstance(value, str):
        # Text stays text: its readers convert it. An entry of numbers may also hold the other kind of number.
        cast(value, kind)


# -- values ------------------------------------------------------------------------------------------------------------


def _encode(value: Any, types: JsonTypes, depth: int) -> Any:
    """Return the JSON of a value. Raises ConversionError if :func:`_decode` could not read it back."""
    if depth > _MAX_DEPTH:
        raise ConversionError(f'a value is nested more than {_MAX_DEPTH} deep')
    if value is None or value is True or value is False or value.__class__ is str:
        return value
    known = types.of_class(value.__class__)
    if known is not None:
        return {TYPE_FIELD: known.name, **_checked(known.to_json(value), known.name)}
    if isinstance(value, NodeStatus):
        return {TYPE_FIELD: ports.NODE_STATUS.name, 'value': value.name}
    if isinstance(value, int | float) and not isinstance(value, Enum):
        if isinstance(value, int):
            return int(value)
        return float(value) if math.isfinite(value) else {TYPE_FIELD: 'double', 'value': str(float(value))}
    if value.__class__ is list:
        return [_encode(item, types, depth + 1) for item in value]
    if value.__class__ is tuple or value.__class__ is deque:
        items = [_encode(item, types, depth + 1) for item in value]
        return {TYPE_FIELD: value.__class__.__qualname__, 'value': items}
    if value.__class__ is dict:
        pairs = [[_encode(part, types, depth + 2) for part in pair] for pair in value.items()]  # lists in a list
        return {TYPE_FIELD: 'dict', 'value': pairs}
    raise ConversionError(f'a {value.__class__.__qualname__} has no JSON form; register one for its class')


def _checked(fields: dict[str, Any], name: str) -> dict[str, Any]:
    try:
        json.dumps(fields, allow_nan=False)
    except (ValueError, TypeError, RecursionError) as error:
        raise ConversionError(f'a {name} gives fields that JSON cannot hold: {error}') from error
    return fields


def _decode(item: Any, types: JsonTypes, depth: int) -> Any:
    """Return the value that this JSON represents. Raises ConversionError."""
    if depth > _MAX_DEPTH:
        raise ConversionError(f'a value is nested more than {_MAX_DEPTH} deep')
    if isinstance(item, list):
        return [_decode(part, types, depth + 1) for part in item]
    if not isinstance(item, dict):
        return item
    name = item.get(TYPE_FIELD)
    if not isinstance(name, str):
        raise ConversionError(f'an object within a value has to have a {TYPE_FIELD!r}')
    fields = {key: part for key, part in item.items() if key != TYPE_FIELD}
    known = types.of_name(name)
    try:
        if known is not None:
            return known.from_json(fields)
        if name == ports.NODE_STATUS.name:
            return NodeStatus[fields['value']]
        if name == 'double':
            return _FLOATS[fields['value']]
        if name in ('tuple', 'deque', 'dict'):
            parts = fields['value']
            if not isinstance(parts, list):
                raise ConversionError(f'the value of a {name} has to be a list')
            values = [_decode(part, types, depth + 1) for part in parts]
            return {'tuple': tuple, 'deque': deque, 'dict': dict}[name](values)
    except (ValueError, TypeError, LookupError) as error:
        raise ConversionError(f'not a {name}: {error}') from error
    raise ConversionError(f'the type {name!r} is not known')
