# SPDX-License-Identifier: BSD-3-Clause
"""The blackboards of the server by name, and their entries as typed values."""

from __future__ import annotations

import threading
import weakref
from collections.abc import Iterable, Sequence
from typing import Any, Final

from flexbt_common.errors import LimitExceededError, UnknownTypeError
from flexbt_common.runtime.weak_lru_cache import WeakLruCache
from flexbt_common.values.entries import Encoding, from_entry, to_entry
from flexbt_common.values.limits import MESSAGE
from flexbt_common.values.value_types import resolve_type
from flexbt_core.behavior_tree.model import ports
from flexbt_core.behavior_tree.model.blackboard import Blackboard
from flexbt_core.behavior_tree.model.errors import BlackboardError
from flexbt_core.behavior_tree.model.ports import PortType
from flexbt_core.errors import FlexbtError
from flexbt_msgs.msg import BlackboardEntry

from .ros_ports import array_type

SHARED: Final = ''
"""Name of the blackboard for goals that name none."""

RECOVERIES_KEY: Final = 'number_recoveries'
"""Key for the number of recovery actions of a run, as in Nav2; each run has a separate value."""

Value = tuple[str, Any, PortType | None]
"""A key, its value, and the type of the value; None for the type of its Python class."""

NO_RECOVERIES: Final[Value] = (RECOVERIES_KEY, 0, None)

_INTEGERS: Final = {
    'int8': ports.INT8,
    'int16': ports.INT16,
    'uint8': ports.UINT8,
    'uint16': ports.UINT16,
    'uint32': ports.UNSIGNED,
    'uint64': ports.UINT64,
}
"""Integer types that keep their size on the blackboard. People write int32 and int64 for any integer, so such an entry
gets the type of the ports that use it."""
_ROS_NAMES: Final = {kind.name: name for name, kind in _INTEGERS.items()}


MOST_BLACKBOARDS: Final = 100
"""Maximum number of unused named blackboards that are kept."""

MOST_KEYS: Final = 10_000
"""Maximum number of entries of one blackboard that clients write. (Trees add the entries that their files name.)"""

MOST_VALUES: Final = 256_000_000
"""Maximum size of all values that clients write, on all blackboards, in characters and bytes."""


class Blackboards:
    """The blackboards by name, created by the first write or run, not by a read. From any thread.

    The shared blackboard always exists. Named ones stay while they are in use; of the unused ones, the
    MOST_BLACKBOARDS most recent ones stay.
    """

    def __init__(self) -> None:
        self._shared = Blackboard()
        self._named: WeakLruCache[str, Blackboard] = WeakLruCache(MOST_BLACKBOARDS)
        self._lengths: weakref.WeakKeyDictionary[Blackboard, dict[str, int]] = weakref.WeakKeyDictionary()
        self._lock = threading.Lock()

    def get(self, name: str) -> Blackboard:
        """Return the blackboard ``name``, created on first use. The caller must hold it while it is in use."""
        return self._shared if name == SHARED else self._named.get(name, Blackboard)

    def find(self, name: str) -> Blackboard:
        """Return the blackboard ``name``, or an empty one that is not kept if it does not exist."""
        return self._shared if name == SHARED else self._named.find(name) or Blackboard()

    def receive(self, name: str, entries: Sequence[BlackboardEntry]) -> list[Value]:
        """Return keys, values and types of entries to be written to the blackboard ``name``.

        Raises:
            FlexbtError: as :func:`read_values`, and if the keys or values exceed a limit.
        """
        values = read_values(entries)
        if not values:
            return values
        board = self.get(name)
        with self._lock:
            keys = set(board.keys())
            new = {entry.key for entry in entries} - keys
            if len(keys) + len(new) > MOST_KEYS:
                raise LimitExceededError(
                    f'blackboard {name!r} has {len(keys)} entries; {len(new)} more would be more than {MOST_KEYS}'
                )
            # Entries that no longer exist do not count.
            known = {key: length for key, length in self._lengths.get(board, {}).items() if key in keys}
            known |= {entry.key: len(entry.text) + len(entry.data) for entry in entries}
            others = sum(sum(lengths.values()) for other, lengths in self._lengths.items() if other is not board)
            total = others + sum(known.values())
            if total > MOST_VALUES:
                raise LimitExceededError(
                    f'the values given to the blackboards would have {total} bytes; at most {MOST_VALUES} are kept: '
                    'write small ones in the place of large ones'
                )
            self._lengths[board] = known
        return values


def read_values(entries: Iterable[BlackboardEntry]) -> list[Value]:
    """Return keys, values and types of entries.

    Raises:
        FlexbtError: an entry has no key or cannot be converted; the text shows key, type and value.
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
        return array_type(resolved)
    return _INTEGERS.get(resolved.name)


def _ros_type(board: Blackboard, key: str) -> str | None:
    """Return the ROS type of an entry, or None if its type on the blackboard is no ROS type."""
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
        # Write to copies of the entries first: if that succeeds, so does the write to the board.
        rehearsal = Blackboard()
        for key, *_ in values:
            entry = board.entry(key)
            if entry is not None:
                rehearsal.declare(key.removeprefix('@'), entry.type).value = entry.value
        for key, value, kind in values:
            rehearsal.set(key.removeprefix('@'), value, kind)
        for key, value, kind in values:
            board.set(key, value, kind)


def entries_of(
    board: Blackboard, keys: Sequence[str], encoding: Encoding
) -> tuple[list[BlackboardEntry], list[str], list[str]]:
    """Return the entries for keys, the missing keys, and the reasons why other keys cannot be converted.

    Values that exceed the limit of a message are not among the entries.
    """
    length = 0
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
            entry = to_entry(key, value, _ros_type(board, key), encoding)
        except FlexbtError as error:
            problems.append(str(error))
            continue
        length += len(entry.text) + len(entry.data)
        if length > MESSAGE:
            problems.append(f'the values from {key!r} on are more than {MESSAGE} bytes; ask for fewer keys at a time')
            break
        entries.append(entry)
    return entries, missing, problems
