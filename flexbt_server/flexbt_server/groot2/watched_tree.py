# SPDX-License-Identifier: BSD-3-Clause
"""A running tree as Groot2 sees it: its structure, statuses, transitions and blackboards."""

from __future__ import annotations

import time
import uuid
from collections import deque
from collections.abc import Callable
from typing import Any, Final

import msgpack

from flexbt_server.behavior_tree import Blackboard, JsonTypes, NodeStatus, Tree, TreeNode, show_blackboard
from flexbt_server.groot2 import protocol
from flexbt_server.groot2.breakpoints import Breakpoints
from flexbt_server.groot2.json_requests import RequestError
from flexbt_server.groot2.tree_document import tree_document

RECORDED: Final = 1000
"""Transitions that a recording keeps, the newest ones, until the client takes them."""

ROOT: Final = 'ROOT'
"""Name of the topmost blackboard in the reply to a request for others."""

_LARGEST: Final = (-(1 << 63), (1 << 64) - 1)


class WatchedTree:
    """Observes one run of a tree, and answers questions about it from the thread of the server."""

    def __init__(
        self, tree: Tree, types: JsonTypes, on_reached: Callable[[int], None], on_held: Callable[[bool], None]
    ) -> None:
        self.tree = tree
        self.uuid = uuid.uuid4().bytes
        self.breakpoints = Breakpoints(tree, on_reached, on_held)
        self._types = types
        self._document: str | None = None
        self._boards: dict[str, Blackboard] = {}
        for subtree in tree.subtrees:
            self._boards.setdefault(subtree.path or subtree.tree_id, subtree.blackboard)
        self._recording = False
        self._recorded: deque[tuple[int, int, NodeStatus]] = deque(maxlen=RECORDED)
        self._recorded_from = 0
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

    def same_tree(self, other: WatchedTree) -> bool:
        """Whether both are runs of one tree, with the same nodes."""
        ours, theirs = self.tree.definitions, other.tree.definitions
        return len(ours) == len(theirs) and all(one is two for one, two in zip(ours, theirs, strict=True))

    # -- on the thread of the run --------------------------------------------------------------------------------------

    def changed(self, node: TreeNode, before: NodeStatus, after: NodeStatus) -> None:
        """A node has another status."""
        uid = node.uid
        self._statuses[self._places[uid]] = protocol.status_byte(before, after)
        if self._recording:
            self._recorded.append((time.perf_counter_ns(), uid, after))

    # -- on the thread of the server -----------------------------------------------------------------------------------

    def document(self) -> bytes:
        if self._document is None:
            self._document = tree_document(self.tree)
        return self._document.encode()

    def statuses(self) -> bytes:
        return bytes(self._statuses)

    def toggle_recording(self, command: bytes) -> bytes | None:
        """Begins to record, and gives the time since the epoch in µs, or ends it."""
        if command == b'start':
            self._recorded_from = time.perf_counter_ns()
            self._recorded = deque(maxlen=RECORDED)
            self._recording = True
            return str(time.time_ns() // 1000).encode()
        if command == b'stop':
            self._recording = False
        return None

    def transitions(self) -> bytes:
        """What was recorded since the last call."""
        recorded, self._recorded = self._recorded, deque(maxlen=RECORDED)
        start = self._recorded_from
        return b''.join(protocol.record(max(0, when - start) // 1000, uid, status) for when, uid, status in recorded)

    def blackboards(self, names: str) -> bytes:
        """Blackboards by the paths of their sub-trees (the tree ID for the main one), separated by ``;``, as msgpack.

        Those that do not exist are left out. Raises RequestError when a sub-tree has the name of the topmost one.
        """
        boards: dict[str, dict[str, Any] | None] = {}
        top: Blackboard | None = None
        for name in names.split(';'):
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
