# SPDX-License-Identifier: BSD-3-Clause
"""A running tree as Groot2 sees it: its structure, statuses, transitions and blackboards."""

from __future__ import annotations

import threading
import time
import uuid
from collections import deque
from collections.abc import Callable
from typing import Any, Final

import msgpack

from flexbt_core.behavior_tree import Blackboard, JsonTypes, Tree, TreeNode, log_reader, show_blackboard

from . import protocol
from .breakpoints import Breakpoints
from .json_requests import RequestError
from .log_buffer import LogBuffer
from .tree_document import tree_document

RECORDED: Final = 1000
"""Transitions that a recording keeps, the newest ones, until the client takes them."""

clock = time.perf_counter_ns
"""That of the logs of watched trees."""

ROOT: Final = 'ROOT'
"""Name of the topmost blackboard in the reply to a request for others."""

_MANY: Final = 2000
"""Marks that are read although nobody asks."""

_LARGEST: Final = (-(1 << 63), (1 << 64) - 1)


class WatchedTree:
    """One run of a tree. What the tree writes to the log is read when a client asks, on the thread of the server."""

    def __init__(
        self,
        tree: Tree,
        log: LogBuffer,
        types: JsonTypes,
        on_reached: Callable[[int], None],
        on_held: Callable[[bool], None],
    ) -> None:
        self.tree = tree
        self.uuid = uuid.uuid4().bytes
        self.breakpoints = Breakpoints(tree, on_reached, on_held)
        self._types = types
        self._document: str | None = None
        self._boards: dict[str, Blackboard] = {}
        for subtree in tree.subtrees:
            self._boards.setdefault(subtree.path or subtree.tree_id, subtree.blackboard)
        # Where the status of each node is: sub-tree by sub-tree, in the order of their making, as clients expect.
        self._places = [0] * (len(tree.nodes) + 1)
        self._statuses = bytearray()
        groups: dict[int, list[TreeNode]] = {id(subtree.blackboard): [] for subtree in tree.subtrees}
        for node in tree.nodes:
            groups[id(node.blackboard)].append(node)
        for group in groups.values():
            for node in group:
                self._statuses += protocol.status_bytes(node.uid, node.status)
                self._places[node.uid] = len(self._statuses) - 1
        self.log = log
        self._reader = log_reader(tree.nodes, self._change)
        self._reading = threading.RLock()
        self._ended = False
        self._recorded: deque[tuple[int, int, int]] = deque(maxlen=RECORDED)
        self._recorded_from = 0
        # Changes whose time has not been read yet.
        self._untimed: list[tuple[int, int]] = []

    def _change(self, uid: int, before: int, after: int) -> tuple[int, int, int, int]:
        """Where and what clients see of it, and what is recorded."""
        return self._places[uid], protocol.status_byte(before, after), uid, after

    def same_tree(self, other: WatchedTree) -> bool:
        """Whether both are runs of one tree, with the same nodes."""
        ours, theirs = self.tree.definitions, other.tree.definitions
        return len(ours) == len(theirs) and all(one is two for one, two in zip(ours, theirs, strict=True))

    def end(self) -> None:
        """Nothing more is about these nodes: reads what was written, and ends a recording of theirs.

        What is written from now on is for another one, also where a request has come late.
        """
        with self._reading:
            self._read()
            self.log.timed = False
            self._ended = True

    def settle(self) -> None:
        """A round of a tick is over. Reads what was written, if it is much."""
        if len(self.log) > _MANY:
            self._read()

    def _read(self) -> None:
        with self._reading:
            if self._ended:
                return
            marks = self.log.take()
            if self.log.timed:
                self._read_timed(marks)
                return
            statuses = self._statuses
            for place, shown, _, _ in self._reader.read([mark for mark in marks if mark >= 0]):
                statuses[place] = shown

    def _read_timed(self, marks: list[int]) -> None:
        for mark in marks:
            if mark < 0:
                self._recorded.extend((~mark, *change) for change in self._untimed)
                self._untimed.clear()
                continue
            for place, shown, uid, after in self._reader.read((mark,)):
                self._statuses[place] = shown
                self._untimed.append((uid, after))

    # -- on the thread of the server -----------------------------------------------------------------------------------

    def document(self) -> bytes:
        if self._document is None:
            self._document = tree_document(self.tree)
        return self._document.encode()

    def statuses(self) -> bytes:
        self._read()
        return bytes(self._statuses)

    def toggle_recording(self, command: bytes) -> bytes | None:
        """Begins to record, and gives the time since the epoch in µs, or ends it."""
        if command not in (b'start', b'stop'):
            return None
        with self._reading:
            self._read()
            self._untimed.clear()
            if not self._ended:
                self.log.timed = command == b'start'
        if command == b'stop':
            return None
        self._recorded.clear()
        self._recorded_from = clock()
        return str(time.time_ns() // 1000).encode()

    def transitions(self) -> bytes:
        """What was recorded since the last call."""
        self._read()
        start = self._recorded_from
        records = [protocol.record(max(0, when - start) // 1000, uid, status) for when, uid, status in self._recorded]
        self._recorded.clear()
        return b''.join(records)

    def blackboards(self, names: str) -> bytes:
        """Blackboards by the paths of their sub-trees (the tree ID for the main one), separated by ``;``, as msgpack.

        Those that do not exist are left out. Raises RequestError when a sub-tree has the name of the topmost one.
        """
        boards: dict[str, dict[str, Any] | None] = {}
        top: Blackboard | None = None
        for name in dict.fromkeys(names.split(';')):
            board = self._boards.get(name)
            if board is None:
                continue
            external = board.root if board.root is not board else None
            if name == ROOT and (external is not None or top is not None):
                raise RequestError(
                    'blackboard dump request uses reserved name [ROOT] together with an external root blackboard export'
                )
            boards[name] = self._shown(board)
            if external is not None and top is None:
                if ROOT in boards:
                    raise RequestError(
                        'blackboard dump request would overwrite subtree [ROOT] with an external root blackboard export'
                    )
                top = external
                boards[ROOT] = self._shown(top)
        # As in BehaviorTree.CPP, what is empty is null.
        packed: bytes = msgpack.packb(_packable(boards) if boards else None, unicode_errors='replace')
        return packed

    def _shown(self, board: Blackboard) -> dict[str, Any] | None:
        return show_blackboard(board, self._types) or None


def _packable(value: Any) -> Any:
    """The value with text in the place of integers that msgpack has no room for."""
    if isinstance(value, dict):
        return {key: _packable(item) for key, item in value.items()}
    if isinstance(value, list):
        return [_packable(item) for item in value]
    if isinstance(value, int) and not _LARGEST[0] <= value <= _LARGEST[1]:
        return str(value)
    return value
