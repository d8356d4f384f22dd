# SPDX-License-Identifier: BSD-3-Clause
"""The memory of loaded trees: its size, the trees to drop for others, and a check of the remaining address space.

The size of a document is estimated from its nodes, ports and scripts, since the same bytes of XML may be two nodes or
two hundred. The estimates are for CPython 3.11, within a third.
"""

from __future__ import annotations

import mmap
import resource
from collections.abc import Collection, Iterable, Mapping
from typing import Final, NamedTuple

from flexbt_common.errors import ResourceError
from flexbt_core.behavior_tree.model.definition import TreeDocument, TreeLibrary
from flexbt_core.behavior_tree.script.interpreter import CompiledScript

MEGABYTE: Final = 1_000_000

MOST_LOADED: Final = 256_000_000
"""Default limit of the memory of all loaded trees, bytes."""

_NODE, _ATTRIBUTES, _VALUE, _SCRIPT_CHARACTER, _TEXT_CHARACTER = 190, 300, 150, 130, 2

_RESERVE: Final = 64 * MEGABYTE
"""Address space reserved for the rest of the process while a document is read, bytes."""


class TreeSize(NamedTuple):
    """The size of a document in memory, in bytes, and the IDs of its sub-trees."""

    size: int
    parts: frozenset[str]


def tree_size(document: TreeDocument, length: int) -> TreeSize:
    """Return the size in memory of a document that was read from ``length`` bytes of XML."""
    values = count = 0
    parts: set[str] = set()
    scripts: set[str] = set()
    different: set[int] = set()  # the reader stores equal attributes only once
    for tree in document.trees.values():
        for node in tree.nodes():
            count += 1
            if node.tree_id is not None:
                parts.add(node.tree_id)
            if id(node.values) in different:
                continue
            different.add(id(node.values))
            values += len(node.values) + len(node.places) + len(node.extra) + len(node.conditions)
            scripts.update(script.text for script in node.conditions.values())
            scripts.update(one.literal.text for one in node.values.values() if isinstance(one.literal, CompiledScript))
    size = _NODE * count + _ATTRIBUTES * len(different) + _VALUE * values + _SCRIPT_CHARACTER * sum(map(len, scripts))
    size += _TEXT_CHARACTER * length * len(different) // max(count, 1)
    return TreeSize(size, frozenset(parts))


def check_room(name: str, content: bytes) -> None:
    """Check that a document can be read where the address space of the process is limited (``ulimit -v``).

    Raises:
        ResourceError: too little is left; the text has the estimated need.
    """
    if resource.getrlimit(resource.RLIMIT_AS)[0] == resource.RLIM_INFINITY:
        return
    needed = 1_200 * content.count(b'<') + 600 * content.count(b'=') + 4 * len(content) + _RESERVE
    try:
        mmap.mmap(-1, needed).close()
    except (OSError, MemoryError):
        raise no_room(name, needed) from None


def no_room(name: str, needed: int) -> ResourceError:
    """Return the error for a document that exceeds the memory; it may need ``needed`` bytes."""
    return ResourceError(
        name,
        f'too little memory: to read it may take {needed // MEGABYTE} MB; raise the limit of the process (ulimit -v), '
        f'or load fewer trees',
    )


class TreeMemory:
    """The size of each loaded document, and the order of their last uses. Not thread-safe."""

    def __init__(self, most: int) -> None:
        """``most``: limit of all documents together, bytes."""
        self._most = most
        self._weights: dict[str, TreeSize] = {}
        self._used: dict[str, None] = {}  # the least recently used first
        self._pinned: frozenset[str] = frozenset()

    def use(self, names: Iterable[str]) -> None:
        """Record that these documents are used now."""
        for name in names:
            self._used.pop(name, None)
            self._used[name] = None

    def pin(self) -> None:
        """Never drop the documents that are loaded now."""
        self._pinned = frozenset(self._weights)

    def put(self, weights: Mapping[str, TreeSize], dropped: Iterable[str]) -> None:
        """Record these documents as loaded, and ``dropped`` as not loaded any more."""
        for name in dropped:
            self._weights.pop(name, None)
            self._used.pop(name, None)
        self._weights.update(weights)
        self.use(weights)

    def to_drop(self, library: TreeLibrary, weights: Mapping[str, TreeSize], kept: Collection[str]) -> list[str]:
        """Return the documents to drop from a library to make room for those of ``weights``: the least recently used
        ones that are not ``kept``, pinned, or part of a document that stays.

        Raises:
            ResourceError: dropping them does not make enough room; the text has the present size and the limit.
        """
        known = {**self._weights, **weights}
        left = {name: known[name] for name in library.documents}
        total = sum(weight.size for weight in left.values())
        excess = total - self._most
        candidates = [name for name in self._used if not (name in self._pinned or name in kept or name in weights)]
        dropped: list[str] = []
        while excess > 0:
            parts = {(id, name) for name, weight in left.items() for id in weight.parts}
            targets = {target.file for id, name in parts if (target := library.find(id, name)) and target.file != name}
            name = next((one for one in candidates if one in left and one not in targets), '')
            if not name:
                raise ResourceError(
                    next(iter(weights)),
                    f'the loaded trees would take {total // MEGABYTE} MB of memory; at most '
                    f'{self._most // MEGABYTE} MB are kept (parameter max_loaded_memory), and what runs, what the '
                    'server was configured with, and what belongs to this request is not dropped',
                )
            dropped.append(name)
            excess -= left.pop(name).size
        return dropped
