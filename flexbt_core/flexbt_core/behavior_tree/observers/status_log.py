# SPDX-License-Identifier: BSD-3-Clause
"""The log of a tree that is watched: what nodes write when a status changes, and what it means.

Writing has to cost next to nothing, so an entry is one integer, a *mark*, of which each node has a tuple ready. Some
marks say several changes at once, and some say what is so already. Reading, which knows the status that each node has
had, makes of them every change, in the order in which the statuses were stored.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from typing import TYPE_CHECKING, Final, Generic, Protocol, TypeVar

from flexbt_core.behavior_tree.model.status import NodeKind, NodeStatus

if TYPE_CHECKING:
    from flexbt_core.behavior_tree.engine.node import TreeNode

# The places of marks in the tuple of a node. At the number of a status: the node has it now.
CHILDREN_IDLE: Final = 5
"""All children of the node are IDLE now."""

EARLIER_CHILDREN_IDLE: Final = 6
"""The children of the node before its first RUNNING one are IDLE now."""

FIRST_CHILDREN_IDLE: Final = 8
"""To be added to the number of a status: all children of the node are IDLE now, and then it has the status."""

_RUNNING: Final = NodeStatus.RUNNING.value
_SHIFT: Final = 4
_PLACES: Final = (1 << _SHIFT) - 1


T = TypeVar('T')


class Log(Protocol):
    """Where marks are written. A list is the fastest."""

    def append(self, mark: int, /) -> None: ...


def marks_of(node: TreeNode) -> tuple[int, ...]:
    """The marks of a node, in their places; of a leaf only those that say nothing of children."""
    leaf = node.kind in (NodeKind.ACTION, NodeKind.CONDITION)
    first = node.uid << _SHIFT
    return tuple(range(first, first + len(NodeStatus) + (0 if leaf else FIRST_CHILDREN_IDLE)))


class LogReader(Generic[T]):
    """Makes transitions of marks. Has to be made before the first mark is written, and to read all of them.

    A transition is what ``make`` gives for a node's uid and the numbers of its statuses before and after; as there are
    not many different ones, each is made once.
    """

    def __init__(self, nodes: Sequence[TreeNode], make: Callable[[int, int, int], T]) -> None:
        self.statuses = bytearray([0, *(node.status for node in nodes)])
        """The number of the status of each node, by its uid, as far as the marks were read."""
        self._children = {node.uid: [child.uid for child in node.attached] for node in nodes if node.attached}
        self._make = make
        self._made: dict[int, T] = {}

    def read(self, marks: Iterable[int]) -> list[T]:
        """The changes that these marks mean, which follow those that were read before."""
        statuses = self.statuses
        made = self._made
        transitions: list[T] = []
        for mark in marks:
            uid, place = mark >> _SHIFT, mark & _PLACES
            if place >= CHILDREN_IDLE:
                for child in self._children[uid]:
                    before = statuses[child]
                    if before == _RUNNING and place == EARLIER_CHILDREN_IDLE:
                        break
                    if before:
                        statuses[child] = 0
                        change = child << _SHIFT + _SHIFT | before
                        transitions.append(made.get(change) or self._made_of(change))
                place -= FIRST_CHILDREN_IDLE
                if place < 0:
                    continue
            before = statuses[uid]
            if before != place:
                statuses[uid] = place
                change = (uid << _SHIFT | place) << _SHIFT | before
                transitions.append(made.get(change) or self._made_of(change))
        return transitions

    def _made_of(self, change: int) -> T:
        made = self._made[change] = self._make(change >> 2 * _SHIFT, change & _PLACES, change >> _SHIFT & _PLACES)
        return made


class TellingLog:
    """A log whose marks are read, and told, at once. They are written to another log as well, if there is one."""

    def __init__(self, reader: LogReader[T], tell: Callable[[T], None], log: Log | None) -> None:
        def append(mark: int, /) -> None:
            if log is not None:
                log.append(mark)
            for transition in reader.read((mark,)):
                tell(transition)

        self.append = append
