# SPDX-License-Identifier: BSD-3-Clause
"""SkipUnlessUpdated, WaitValueUpdate and WasEntryUpdated: has an entry of the blackboard been written?

Each node remembers the number of writes that it saw last, at first none, and for as long as the tree lives. What is
asked is whether there was a write, not whether the value is another one. An entry that was removed and made anew counts
its writes from the beginning; as many as before go unnoticed, as in BehaviorTree.CPP.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

from .blackboard import MISSING
from .leaves import LeafNode
from .node import DecoratorNode, NodeConfig
from .port_types import ANY, KEY
from .ports import Port, input_port
from .status import FAILURE, IDLE, RUNNING, SKIPPED, SUCCESS, NodeKind, NodeStatus

_PORTS: Final[Mapping[str, Port]] = {'entry': input_port(ANY, literal=KEY, description='the entry: {key}, or just key')}


class _Watch:
    """The writes of the entry to which the port ``entry`` of a node points. ``seen`` is how many were seen."""

    __slots__ = ('_board', 'entry', 'key', 'seen')

    def __init__(self, config: NodeConfig) -> None:
        given = config.values['entry']
        self.key = given.text if given.key is None else given.key
        self._board = config.blackboard
        self.entry = MISSING
        self.seen = 0

    def updated(self) -> bool:
        """Whether the entry was written since the last call. One that is missing was not."""
        entry = self.entry
        if not entry.present:
            self.entry = entry = self._board.entry(self.key) or MISSING
        writes = entry.sequence
        if writes == self.seen or entry is MISSING:
            return False
        self.seen = writes
        return True


class _UpdateDecorator(DecoratorNode):
    """Ticks the child when the entry was written since the last time, and then until the child is no longer RUNNING."""

    __slots__ = ('_child_running', '_watch')

    running_first = None
    ports = _PORTS

    def __init__(self, config: NodeConfig) -> None:
        super().__init__(config)
        self._watch = _Watch(config)
        self._child_running = False

    def _run(self) -> NodeStatus:
        status = self._tick()
        self._child_running = status is RUNNING
        if status is not SKIPPED:
            self.status = status
            if status is not RUNNING:
                self.child.status = IDLE
        return status

    def halt(self) -> None:
        self._child_running = False
        super().halt()


class SkipUnlessUpdated(_UpdateDecorator):
    """Runs the child when ``entry`` was written since the last time; SKIPPED otherwise. A halt does not undo that."""

    __slots__ = ()

    def execute(self) -> NodeStatus:
        if not self._child_running:
            watch = self._watch
            # Nothing new is what most ticks find; a call would take longer than that.
            if watch.entry.sequence == watch.seen or not watch.updated():
                return SKIPPED
        return self._run()


class WaitValueUpdate(_UpdateDecorator):
    """Waits, RUNNING, until ``entry`` is written, and then runs the child. A halt does not undo what was seen.

    The write itself asks for no wake-up: what makes it, a leaf of the tree or its host, has to tick the tree.
    """

    __slots__ = ()

    def execute(self) -> NodeStatus:
        if not self._child_running:
            watch = self._watch
            if watch.entry.sequence == watch.seen or not watch.updated():
                self.status = RUNNING
                return RUNNING
        return self._run()


class WasEntryUpdated(LeafNode):
    """SUCCESS when ``entry`` was written since the last tick of this node; FAILURE when not, or when it is missing."""

    __slots__ = ('_watch',)

    kind = NodeKind.ACTION
    ports = _PORTS

    def __init__(self, config: NodeConfig) -> None:
        super().__init__(config)
        self._watch = _Watch(config)

    def execute(self) -> NodeStatus:
        status = SUCCESS if self._watch.updated() else FAILURE
        self.status = status
        return status

    def failure_reason(self) -> str:
        return f'{self.id}: entry [{self._watch.key}] was not written since the last tick'
