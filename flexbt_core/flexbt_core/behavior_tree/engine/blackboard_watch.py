# SPDX-License-Identifier: BSD-3-Clause
"""A record of who writes the entries of blackboards, for debugging.

A watched entry gets a derived class in which ``value`` is a property, as nodes with observers do (``observers``). So
entries that nobody watches cost nothing, and generated code of scripts is recorded, too. The writer is the node whose
code is on the stack, of any tree on the blackboard.
"""

from __future__ import annotations

import inspect
from collections import deque
from collections.abc import Callable, Iterable
from typing import Any, Final, NamedTuple

from flexbt_core.behavior_tree.model.blackboard import EMPTY, Blackboard, Entry
from flexbt_core.behavior_tree.model.ports import PortType
from flexbt_core.values.text import short_repr

from .node import NodeScript, TreeNode

MOST_WRITES: Final = 5
"""Number of the latest writes of an entry that are kept."""

_SLOT: Final[Any] = vars(Entry)['value']


class EntryWrite(NamedTuple):
    """One write of an entry. ``writer`` is the path of the node, '' if no node wrote it; ``when`` is in seconds."""

    writer: str
    when: float
    value: str


class EntryWrites:
    """The writes of one entry: their number, and the latest ones, the newest first."""

    def __init__(self) -> None:
        self.count = 0
        self.latest: deque[EntryWrite] = deque(maxlen=MOST_WRITES)


_NONE: Final = EntryWrites()


class BlackboardWatch:
    """The watch of any number of blackboards, by any number of clients. ``now`` returns the time of a write, s.

    ``outside``: who writes at this moment if no node does.
    """

    def __init__(self, now: Callable[[], float]) -> None:
        self._writes: dict[Entry, EntryWrites] = {}
        self._boards: dict[object, tuple[Blackboard, ...]] = {}
        self._sources: set[Blackboard] = set()
        self.outside = ''

        def begin(entry: Entry, type: PortType | None) -> None:
            self._writes[entry] = EntryWrites()
            _SLOT.__set__(entry, EMPTY)  # without recording that
            entry.type = type
            entry.sequence = 0
            entry.present = True

        def write(entry: Entry, value: Any) -> None:
            _SLOT.__set__(entry, value)
            if not entry.present:  # it was removed, and nobody can ask for it
                self._writes.pop(entry, None)
                return
            writes = self._writes.setdefault(entry, EntryWrites())
            writes.count += 1
            shown = 'nothing' if value is EMPTY else short_repr(value)
            writes.latest.appendleft(EntryWrite(_writer_on_stack() or self.outside, now(), shown))

        namespace = {'__slots__': (), 'value': property(_SLOT.__get__, write), '__init__': begin}
        self._watched: type[Entry] = type('WatchedEntry', (Entry,), namespace)

    def watch(self, client: object, boards: Iterable[Blackboard]) -> None:
        """Watch these blackboards for a client, and no others."""
        self._boards[client] = tuple(boards)
        self._mark()

    def leave(self, client: object) -> None:
        """Stop watching for a client. The writes of entries that nobody watches are dropped."""
        if self._boards.pop(client, None) is not None:
            self._mark()

    def is_watching(self, client: object) -> bool:
        """Return whether something is watched for a client."""
        return client in self._boards

    def writes(self, entry: Entry) -> EntryWrites:
        """Return the recorded writes of an entry."""
        return self._writes.get(entry, _NONE)

    def _mark(self) -> None:
        boards = {board for boards in self._boards.values() for board in (*boards, *(one.root for one in boards))}
        entries = {entry for board in boards for entry in board.entries().values()}
        for entry in self._writes.keys() - entries:
            entry.__class__ = Entry
            self._writes.pop(entry, None)  # the tree may have removed it meanwhile
        for entry in entries:
            if entry.__class__ is not self._watched:
                self._writes[entry] = EntryWrites()
                entry.__class__ = self._watched
        for board in self._sources - {board.source for board in boards}:
            board.entry_class = Entry
        self._sources = {board.source for board in boards}
        for board in self._sources:
            board.entry_class = self._watched


def _writer_on_stack() -> str:
    frame: Any = inspect.currentframe()
    while frame is not None:
        owner = frame.f_locals.get('self')
        if isinstance(owner, TreeNode):
            return owner.path
        if isinstance(owner, NodeScript):
            return f'{owner.node.path} ({owner.attribute})'
        frame = frame.f_back
    return ''
