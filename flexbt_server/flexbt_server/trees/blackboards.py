# SPDX-License-Identifier: BSD-3-Clause
"""The blackboards of the server by name, and their entries as typed values."""

from __future__ import annotations

import threading
from collections.abc import Iterable, Sequence
from typing import Any, Final

from flexbt_common.errors import UnknownTypeError
from flexbt_common.values import Encoding, from_entry, resolve_type, to_entry
from flexbt_core.behavior_tree import Blackboard, BlackboardError, PortType
from flexbt_core.behavior_tree.model import port_types
from flexbt_core.errors import FlexbtError
from flexbt_msgs.msg import BlackboardEntry

SHARED: Final = ''
"""Name of the blackboard that trees run on when the goal names none."""

RECOVERIES_KEY: Final = 'number_recoveries'
"""Key in which the recovery actions of a run are counted, as in Nav2; each run has its own."""

Value = tuple[str, Any, PortType | None]
"""A key, what to write to it, and as which type; None: the one of its Python class."""

NO_RECOVERIES: Final[Value] = (RECOVERIES_KEY, 0, None)

_INTEGERS: Final = {
    'int8': port_types.INT8,
    'int16': port_types.INT16,
    'uint8': port_types.UINT8,
    'uint16': port_types.UINT16,
    'uint32': port_types.UNSIGNED,
    'uint64': port_types.UINT64,
}
"""Integers that keep their size on the blackboard. int32 and int64 are what people write for any integer: an entry
gets the type of the ports that use it."""
_ROS_NAMES: Final = {kind.name: name for name, kind in _INTEGERS.items()}


class Blackboards:
    """Blackboards by name; one is made when it is first named. Safe to use from several threads."""

    def __init__(self) -> None:
        self._boards: dict[str, Blackboard] = {SHARED: Blackboard()}
        self._lock = threading.Lock()

    def get(self, name: str) -> Blackboard:
        """The blackboard called ``name``."""
        with self._lock:
            return self._boards.setdefault(name, Blackboard())


def read_values(entries: Iterable[BlackboardEntry]) -> list[Value]:
    """Keys, values and types of entries.

    Raises:
        FlexbtError: an entry without a key, or one that cannot be converted; names key, type and text.
    """
    values: list[Value] = []
    for entry in entries:
        if not entry.key:
            raise FlexbtError(f'an entry of type {entry.type!r} has no key')
        values.append((entry.key, from_entry(entry), _port_type(entry.type)))
    return values


def _port_type(ros_type: str) -> PortType | None:
    resolved = resolve_type(ros_type)
    if resolved.is_array:
        return PortType(resolved.name, list)  # an empty list does not say of what
    return _INTEGERS.get(resolved.name)


def _ros_type(board: Blackboard, key: str) -> str | None:
    """The ROS type of an entry, where its type on the blackboard is one."""
    entry = board.entry(key)
    if entry is None or entry.type is None:
        return None
    name = _ROS_NAMES.get(entry.type.name, entry.type.name)
    try:
        return resolve_type(name).name
    except UnknownTypeError:
        return None


def write_all(board: Blackboard, values: Sequence[Value]) -> None:
    """Write all of the values, or none of them.

    Raises:
        BlackboardError: an entry has another type.
    """
    with board.lock:
        # A copy with the same types takes the values first: what it takes, the board takes.
        rehearsal = Blackboard()
        for key, value, kind in values:
            entry = board.entry(key)
            if entry is not None and entry.type is not None:
                rehearsal.declare(key.removeprefix('@'), entry.type)
            rehearsal.set(key.removeprefix('@'), value, kind)
        for key, value, kind in values:
            board.set(key, value, kind)


def entries_of(
    board: Blackboard, keys: Sequence[str], encoding: Encoding
) -> tuple[list[BlackboardEntry], list[str], list[str]]:
    """Typed values of keys: the entries, the keys that are missing, and why other keys cannot be converted."""
    entries: list[BlackboardEntry] = []
    missing: list[str] = []
    problems: list[str] = []
    for key in keys:
        try:
            value = board.get(key)
        except BlackboardError:
            missing.append(key)
            continue
        try:
            entries.append(to_entry(key, value, _ros_type(board, key), encoding))
        except FlexbtError as error:
            problems.append(str(error))
    return entries, missing, problems
