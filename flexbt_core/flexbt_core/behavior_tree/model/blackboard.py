# SPDX-License-Identifier: BSD-3-Clause
"""The blackboard: typed entries, one scope per sub-tree.

A key is looked up in the scope itself, then through an explicit remapping in the parent, then, when the scope is
autoremapped and the key does not begin with ``_``, under the same name in the parent. ``@key`` is an entry of the
topmost scope. An entry gets its type from the first port or value that is not text, and keeps it (``is_fixed``).
"""

from __future__ import annotations

import threading
from collections.abc import Iterable, Iterator, MutableMapping
from enum import Enum
from typing import Any, Final

from flexbt_core.values.text import short_repr

from .errors import BlackboardError, ConversionError
from .ports import ANY, BOOL, NUMBERS, PortType, cast, is_fixed, type_of


class _Empty(Enum):
    EMPTY = 'empty'


EMPTY: Final = _Empty.EMPTY
"""The value of an entry that is declared but was never written."""


class Entry:
    """One entry: ``value`` (EMPTY until written), ``type`` (None or ANY: not fixed yet), and the number of writes.
    Once the entry is removed from its blackboard, ``present`` is False, it is empty, and the number of writes is one
    that no present entry has."""

    __slots__ = ('present', 'sequence', 'type', 'value')

    def __init__(self, type: PortType | None) -> None:
        self.value: Any = EMPTY
        self.type = type
        self.sequence = 0
        self.present = True

    @classmethod
    def constant(cls, value: Any) -> Entry:
        """Return an entry with a constant value that belongs to no blackboard."""
        entry = cls(None)
        entry.value = value
        return entry

    def write(self, value: Any) -> None:
        """Store the value unchanged. The caller has checked the type.

        Two stores without a call between them, so no other thread runs between them. A caller that does not need the
        previous value needs no lock, and may inline these two lines where a call would take too long.
        """
        self.value = value
        self.sequence += 1


MISSING: Final = Entry(None)
"""Placeholder for a missing entry, for code that keeps an entry and checks whether it is present."""
MISSING.present = False
MISSING.sequence = -1


class Blackboard:
    """A scope of entries. Safe to use from several threads; a scope and its descendants share one lock."""

    __slots__ = ('__weakref__', '_autoremap', '_entries', '_parent', '_remaps', '_root', 'entry_class', 'lock')

    entry_class: type[Entry]
    """Class of the entries to be created, which is used of the :attr:`source`."""

    def __init__(self, parent: Blackboard | None = None) -> None:
        self._parent = parent
        self._root: Blackboard = parent._root if parent is not None else self
        self.lock: threading.RLock = parent.lock if parent is not None else threading.RLock()
        self._entries: MutableMapping[str, Entry] = {}
        self._remaps: dict[str, str] = {}
        self._autoremap = False
        self.entry_class = Entry

    def with_own(self, keys: Iterable[str]) -> Blackboard:
        """Return a topmost scope that shares all entries of this one, except private ones for ``keys``.

        So several trees share the data that they exchange, and each keeps the data of its run private.
        """
        board = Blackboard()
        board.lock = self.lock
        board._entries = _Overlay(self, self._entries, frozenset(keys))
        return board

    @property
    def parent(self) -> Blackboard | None:
        return self._parent

    @property
    def root(self) -> Blackboard:
        """Topmost scope, which ``@key`` addresses."""
        return self._root

    @property
    def source(self) -> Blackboard:
        """The topmost scope, or the one whose entries that shares; see :meth:`with_own`."""
        entries = self._root._entries
        return entries.board.source if isinstance(entries, _Overlay) else self._root

    def remap(self, key: str, parent_key: str) -> None:
        """Map ``key`` to ``parent_key`` of the parent, unless this scope has an entry ``key``."""
        self._remaps[key] = parent_key

    def enable_autoremap(self, enable: bool = True) -> None:
        """Map every key that is not private (``_``) to the same key of the parent."""
        self._autoremap = enable

    # -- access ------------------------------------------------------------------------------------------------------

    def entry(self, key: str) -> Entry | None:
        """Return the entry that ``key`` means in this scope, in any scope; None if it does not exist."""
        board: Blackboard | None = self
        while board is not None:
            if key.startswith('@'):
                board, key = board._root, key[1:]
            entry = board._entries.get(key)
            if entry is not None:
                return entry
            remapped = board._remaps.get(key)
            if remapped is not None:
                key = remapped
            elif not board._autoremap or key.startswith('_'):
                return None
            board = board._parent
        return None

    def outermost(self, key: str) -> tuple[Blackboard, str]:
        """Return the scope that has the entry of ``key``, or where a write would create it, and its key there."""
        board = self
        while not key.startswith('@') and key not in board._entries and board._parent is not None:
            remapped = board._remaps.get(key)
            if remapped is None and (not board._autoremap or key.startswith('_')):
                break
            board, key = board._parent, key if remapped is None else remapped
        return (board._root, key[1:]) if key.startswith('@') else (board, key)

    def get(self, key: str) -> Any:
        """Return the value of ``key``. Raises BlackboardError if it is missing or was never written."""
        entry = self.entry(key)
        if entry is None:
            raise BlackboardError(f'missing key [{key}]', is_absent=True)
        value = entry.value
        if value is EMPTY:
            raise BlackboardError(f'entry [{key}] was declared but never written', is_absent=True)
        return value

    def get_or(self, key: str, default: Any) -> Any:
        """Return the value of ``key``, or ``default`` when it is missing or was never written."""
        entry = self.entry(key)
        return default if entry is None or entry.value is EMPTY else entry.value

    def declare(self, key: str, type: PortType | None) -> Entry:
        """Return the entry of ``key``, created without a value where a write would create it.

        Raises BlackboardError when it exists with another type.
        """
        with self.lock:
            board = self
            while True:
                if key.startswith('@'):
                    board, key = board._root, key[1:]
                    if '@' in key:
                        raise BlackboardError(f"character '@' is used several times in the key [@{key}]")
                entry = board._entries.get(key)
                if entry is not None:
                    if is_fixed(entry.type) and is_fixed(type) and not entry.type.same(type):
                        raise _type_clash(key, entry.type, type)
                    return entry
                remapped = board._remaps.get(key)
                if remapped is None and (not board._autoremap or key.startswith('_')):
                    entry = board._entries[key] = self.source.entry_class(type)
                    return entry
                if board._parent is None:
                    raise BlackboardError(f'key [{key}] is remapped to a parent blackboard, but there is none')
                board, key = board._parent, remapped if remapped is not None else key

    def set(self, key: str, value: Any, type: PortType | None = None) -> None:
        """Write ``value``, whose type is ``type`` (by default the one of its Python class).

        Raises BlackboardError when the entry has another type that the value cannot be converted to without loss.
        """
        if key.startswith('@'):
            self._root.set(key[1:], value, type)
            return
        try:
            kind = type if is_fixed(type) else type_of(value)
        except ConversionError as error:
            raise BlackboardError(f'entry [{key}]: {error}') from error
        with self.lock:
            entry = self._entries.get(key)
            if entry is None:
                # Text does not fix the type of a new entry. What is written through a remapping is checked by
                # its type only and not converted, so text gets even into an entry of numbers. Readers convert it; the
                # scope that has the entry can write nothing else there then.
                self.declare(key, None if kind.category == 'text' else kind).write(value)
            elif not is_fixed(entry.type):
                entry.type = kind
                entry.write(value)
            else:
                entry.write(_converted(key, entry, value, kind))

    def put(self, key: str, value: Any, type: PortType | None) -> None:
        """Write a value, or EMPTY, read from an entry of this ``type``, which must match the entry of ``key``.

        Unlike :meth:`set` it converts nothing, not even numbers. An entry of this scope without a fixed type may then
        hold anything (ANY).
        """
        if key.startswith('@'):
            self._root.put(key[1:], value, type)
            return
        kind = type if is_fixed(type) or value is EMPTY else type_of(value)
        with self.lock:
            entry = self._entries.get(key)
            if entry is None:
                entry = self.declare(key, kind)
            elif not is_fixed(entry.type):
                entry.type = ANY
            elif not is_fixed(kind) or not entry.type.same(kind):
                raise _type_clash(key, entry.type, kind)
            entry.write(value)

    def unset(self, key: str) -> None:
        """Remove the entry from this scope; neither remapping nor ``@`` apply. No error if it is missing."""
        if key not in self._entries:
            return
        with self.lock:
            entry = self._entries.pop(key, None)
            if entry is not None:
                entry.present = False
                entry.value = EMPTY
                entry.sequence = -1

    def keys(self) -> list[str]:
        """Return the keys of the entries of this scope itself."""
        with self.lock:
            return list(self._entries)

    def entries(self) -> dict[str, Entry]:
        """Return the entries of this scope itself at one moment, by their keys: the entries themselves, not
        copies."""
        with self.lock:
            return dict(self._entries)

    def snapshot(self) -> dict[str, Any]:
        """Return keys and values of this scope at one moment, without entries that were never written."""
        with self.lock:
            return {key: entry.value for key, entry in self._entries.items() if entry.value is not EMPTY}

    def __contains__(self, key: str) -> bool:
        return self.entry(key) is not None

    def __iter__(self) -> Iterator[str]:
        return iter(self.keys())


class _Overlay(MutableMapping[str, Entry]):
    """The entries ``shared`` of a ``board``, with private entries for the keys ``own_keys``."""

    __slots__ = ('_own', '_own_keys', '_shared', 'board')

    def __init__(self, board: Blackboard, shared: MutableMapping[str, Entry], own_keys: frozenset[str]) -> None:
        self.board = board
        self._shared = shared
        self._own_keys = own_keys
        self._own: dict[str, Entry] = {}

    def __getitem__(self, key: str) -> Entry:
        return self._of(key)[key]

    def __setitem__(self, key: str, entry: Entry) -> None:
        self._of(key)[key] = entry

    def __delitem__(self, key: str) -> None:
        del self._of(key)[key]

    def __iter__(self) -> Iterator[str]:
        yield from self._own
        yield from (key for key in self._shared if key not in self._own_keys)

    def __len__(self) -> int:
        return sum(1 for _ in self)

    def _of(self, key: str) -> MutableMapping[str, Entry]:
        return self._own if key in self._own_keys else self._shared


def _type_clash(key: str, declared: PortType, written: PortType | None) -> BlackboardError:
    used = 'one without a type' if written is None else written.name
    return BlackboardError(
        f'entry [{key}] has the type {declared.name}, which cannot be changed; it was now used as {used}'
    )


def _converted(key: str, entry: Entry, value: Any, kind: PortType) -> Any:
    """Return the value that a typed entry stores when ``value`` of type ``kind`` is written to it."""
    declared = entry.type
    assert declared is not None
    if not declared.same(kind):
        if kind.category == 'text' and isinstance(value, str):
            if declared.from_text is None:
                raise _type_clash(key, declared, kind)
            try:
                value = declared.parse(value)
            except ConversionError as error:
                raise BlackboardError(f'entry [{key}]: {error}') from error
        else:
            # A bool entry rejects numbers, and an entry of text or objects rejects all other types.
            if kind.category not in NUMBERS or declared.category not in NUMBERS or declared is BOOL:
                raise _type_clash(key, declared, kind)
            try:
                exact = cast(value, declared)
            except ConversionError as error:
                raise BlackboardError(f'{_type_clash(key, declared, kind)}: {error}') from error
            # As in BehaviorTree.CPP: the first number that a declared entry gets keeps its kind, if it fits.
            value = value if entry.value is EMPTY and kind.category == 'real' else exact
    present = entry.value
    if present is not EMPTY and _family(present) is not _family(value):
        # The present value came through a sub-tree port, or from a script when the entry was only declared.
        raise BlackboardError(
            f'entry [{key}] of type {declared.name} holds {short_repr(present)}, '
            f'and so does not take {short_repr(value)}; it has to be removed first'
        )
    return float(value) if present.__class__ is float else value


def _family(value: Any) -> type[Any]:
    """Return the class of the values that a value may be replaced by."""
    return str if isinstance(value, str) else float if isinstance(value, int | float) else object
