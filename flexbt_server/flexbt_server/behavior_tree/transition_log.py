# SPDX-License-Identifier: BSD-3-Clause
"""The log of a tree that is watched: what nodes write when a status changes, and what it means.

Writing has to cost next to nothing, so an entry is one integer, a *mark*, of which each node has a tuple ready. Some
marks say several changes at once, and some say what is so already. Reading, which knows the status that each node has
had, makes of them every change, in the order in which the statuses were stored.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from typing import TYPE_CHECKING, Final, Protocol, TypeAlias

from .status import NodeStatus

if TYPE_CHECKING:
    from .node import TreeNode

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


Transition: TypeAlias = tuple[int, int, int]
"""A change of the status of a node: its uid, and the numbers of the statuses before and after."""


class Log(Protocol):
    """Where marks are written. A list is the fastest."""

    def append(self, mark: int, /) -> None: ...


def marks_of(uid: int) -> tuple[int, ...]:
    """The marks of a node."""
    return tuple(range(uid << _SHIFT, (uid << _SHIFT) + FIRST_CHILDREN_IDLE + len(NodeStatus)))


class LogReader:
    """Makes transitions of marks. Has to be made before the first mark is written, and to read all of them."""

    def __init__(self, nodes: Sequence[TreeNode]) -> None:
        self.statuses = bytearray(node.status for node in nodes)
        """The number of the status of each node, as far as the marks were read; the index is uid - 1."""
        self._children = {node.uid: [child.uid for child in node.attached] for node in nodes if node.attached}

    def read(self, marks: Iterable[int]) -> list[Transition]:
        """The changes that these marks mean, which follow those that were read before."""
        statuses = self.statuses
        transitions: list[Transition] = []
        for mark in marks:
            uid, place = mark >> _SHIFT, mark & _PLACES
            if place >= CHILDREN_IDLE:
                for child in self._children[uid]:
                    before = statuses[child - 1]
                    if before == _RUNNING and place == EARLIER_CHILDREN_IDLE:
                        break
                    if before:
                        statuses[child - 1] = 0
                        transitions.append((child, before, 0))
                place -= FIRST_CHILDREN_IDLE
                if place < 0:
                    continue
            before = statuses[uid - 1]
            if before != place:
                statuses[uid - 1] = place
                transitions.append((uid, before, place))
        return transitions


class TellingLog:
    """A log whose marks are read, and told, at once. They are written to another log as well, if there is one."""

    def __init__(self, reader: LogReader, tell: Callable[[Transition], None], log: Log | None) -> None:
        self._reader = reader
        self._tell = tell
        self._log = log

    def append(self, mark: int, /) -> None:
        if self._log is not None:
            self._log.append(mark)
        for transition in self._reader.read((mark,)):
            self._tell(transition)
