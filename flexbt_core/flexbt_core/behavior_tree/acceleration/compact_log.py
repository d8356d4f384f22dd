# SPDX-License-Identifier: BSD-3-Clause
"""Marks of the status log that say several changes at once, and some that say what is so already."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from typing import Final, TypeVar

from flexbt_core.behavior_tree.engine import TreeNode
from flexbt_core.behavior_tree.model import NodeKind, NodeStatus
from flexbt_core.behavior_tree.status_log import PLACES, SHIFT, LogReader

# The places of marks in the tuple of a node. At the number of a status: the node has it now.
CHILDREN_IDLE: Final = 5
"""All children of the node are IDLE now."""

EARLIER_CHILDREN_IDLE: Final = 6
"""The children of the node before its first RUNNING one are IDLE now."""

FIRST_CHILDREN_IDLE: Final = 8
"""To be added to the number of a status: all children of the node are IDLE now, and then it has the status."""

_RUNNING: Final = NodeStatus.RUNNING.value

T = TypeVar('T')


def marks_of(node: TreeNode) -> tuple[int, ...]:
    """The marks of a node, in their places; of a leaf only those that say nothing of children."""
    leaf = node.kind in (NodeKind.ACTION, NodeKind.CONDITION)
    first = node.uid << SHIFT
    return tuple(range(first, first + len(NodeStatus) + (0 if leaf else FIRST_CHILDREN_IDLE)))


class CompactLogReader(LogReader[T]):
    """A reader that knows such marks."""

    def __init__(self, nodes: Sequence[TreeNode], make: Callable[[int, int, int], T]) -> None:
        super().__init__(nodes, make)
        self._children = {node.uid: [child.uid for child in node.attached] for node in nodes if node.attached}

    def read(self, marks: Iterable[int]) -> list[T]:
        statuses = self.statuses
        made = self._made
        transitions: list[T] = []
        for mark in marks:
            uid, place = mark >> SHIFT, mark & PLACES
            if place >= CHILDREN_IDLE:
                for child in self._children[uid]:
                    before = statuses[child]
                    if before == _RUNNING and place == EARLIER_CHILDREN_IDLE:
                        break
                    if before:
                        statuses[child] = 0
                        change = child << SHIFT + SHIFT | before
                        transitions.append(made.get(change) or self._transition(child, before, 0))
                place -= FIRST_CHILDREN_IDLE
                if place < 0:
                    continue
            before = statuses[uid]
            if before != place:
                statuses[uid] = place
                change = (uid << SHIFT | place) << SHIFT | before
                transitions.append(made.get(change) or self._transition(uid, before, place))
        return transitions
