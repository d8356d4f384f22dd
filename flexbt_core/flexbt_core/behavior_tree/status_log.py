# SPDX-License-Identifier: BSD-3-Clause
"""A log of the changes of statuses of a tree, to be read later, maybe by another thread.

Writing has to cost next to nothing, so an entry is one integer, a *mark*: the number of the node, and that of the
status that it has now. Reading, which knows the status that each node has had, makes the changes of them, in the order
in which the statuses were stored.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from typing import Final, Generic, Protocol, TypeVar

from flexbt_core.behavior_tree.engine import TreeNode
from flexbt_core.behavior_tree.model import NodeStatus, acceleration

SHIFT: Final = 4
"""The bits of a mark that are not the number of the node."""
PLACES: Final = (1 << SHIFT) - 1

T = TypeVar('T')


class Log(Protocol):
    """Where marks are written. A list is the fastest."""

    def append(self, mark: int, /) -> None: ...


class StatusLog:
    """An observer that writes every change to a log: ``tree.observe(StatusLog(log))``."""

    def __init__(self, log: Log) -> None:
        self.log = log

    def __call__(self, node: TreeNode, before: NodeStatus, after: NodeStatus) -> None:
        self.log.append(node.uid << SHIFT | after)


class LogReader(Generic[T]):
    """Makes transitions of marks. Made by :func:`log_reader`."""

    def __init__(self, nodes: Sequence[TreeNode], make: Callable[[int, int, int], T]) -> None:
        self.statuses = bytearray([0, *(node.status for node in nodes)])
        """The number of the status of each node, by its uid, as far as the marks were read."""
        self._make = make
        self._made: dict[int, T] = {}

    def read(self, marks: Iterable[int]) -> list[T]:
        """The changes that these marks mean, which follow those that were read before."""
        statuses = self.statuses
        transitions: list[T] = []
        for mark in marks:
            uid, status = mark >> SHIFT, mark & PLACES
            transitions.append(self._transition(uid, statuses[uid], status))
            statuses[uid] = status
        return transitions

    def _transition(self, uid: int, before: int, after: int) -> T:
        """There are not many different ones: each is made once."""
        change = (uid << SHIFT | after) << SHIFT | before
        made = self._made.get(change)
        if made is None:
            made = self._made[change] = self._make(uid, before, after)
        return made


def log_reader(nodes: Sequence[TreeNode], make: Callable[[int, int, int], T]) -> LogReader[T]:
    """What reads the log of the tree of these nodes.

    Has to be made before the first mark is written, and to read all of them. A transition is what ``make`` gives for a
    node's uid and the numbers of its statuses before and after.
    """
    return acceleration().class_of(LogReader)(nodes, make)
