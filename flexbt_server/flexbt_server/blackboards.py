# SPDX-License-Identifier: BSD-3-Clause
"""The blackboards of the server by name, and their entries as typed values."""

from __future__ import annotations

import threading
from collections.abc import Iterable, Sequence
from typing import Any, Final

from flexbt_common.errors import FlexbtError
from flexbt_common.values import Encoding, from_entry, to_entry
from flexbt_msgs.msg import BlackboardEntry
from flexbt_server.behavior_tree import Blackboard, BlackboardError

SHARED: Final = ''
"""Name of the blackboard that trees run on when the goal names none."""

RECOVERIES_KEY: Final = 'number_recoveries'
"""Key in which the recovery actions of a run are counted, as in Nav2."""


class Blackboards:
    """Blackboards by name; one is made when it is first named. Safe to use from several threads."""

    def __init__(self) -> None:
        self._boards: dict[str, Blackboard] = {SHARED: Blackboard()}
        self._lock = threading.Lock()

    def get(self, name: str) -> Blackboard:
        """The blackboard called ``name``."""
        with self._lock:
            return self._boards.setdefault(name, Blackboard())


def read_values(entries: Iterable[BlackboardEntry]) -> list[tuple[str, Any]]:
    """Keys and values of entries.

    Raises:
        FlexbtError: an entry without a key, or one that cannot be converted; names key, type and text.
    """
    values = []
    for entry in entries:
        if not entry.key:
            raise FlexbtError(f'an entry of type {entry.type!r} has no key')
        values.append((entry.key, from_entry(entry)))
    return values


def write_all(board: Blackboard, values: Sequence[tuple[str, Any]]) -> None:
    """Write all of the values, or none of them.

    Raises:
        BlackboardError: an entry has another type.
    """
    with board.lock:
        # A copy with the same types takes the values first: what it takes, the board takes.
        rehearsal = Blackboard()
        for key, value in values:
            entry = board.entry(key)
            if entry is not None and entry.type is not None:
                rehearsal.declare(key.removeprefix('@'), entry.type)
            rehearsal.set(key.removeprefix('@'), value)
        for key, value in values:
            board.set(key, value)


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
            entries.append(to_entry(key, value, encoding=encoding))
        except FlexbtError as error:
            problems.append(str(error))
    return entries, missing, problems
