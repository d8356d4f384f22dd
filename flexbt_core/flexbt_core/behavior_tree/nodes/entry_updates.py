# SPDX-License-Identifier: BSD-3-Clause
"""SkipUnlessUpdated, WaitValueUpdate and WasEntryUpdated: has an entry of the blackboard been written?

Each node remembers the number of writes that it saw last, at first none, and for as long as the tree lives. What is
asked is whether there was a write, not whether the value is another one. An entry that was removed and made anew counts
its writes from the beginning; as many as before go unnoticed, as in BehaviorTree.CPP.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

from flexbt_core.behavior_tree.engine import DecoratorNode, LeafNode, NodeConfig
from flexbt_core.behavior_tree.model import (
    ANY,
    FAILURE,
    IDLE,
    KEY,
    MISSING,
    RUNNING,
    SKIPPED,
    SUCCESS,
    Example,
    NodeKind,
    NodeStatus,
    Port,
    input_port,
)

_PORTS: Final[Mapping[str, Port]] = {'entry': input_port(ANY, literal=KEY, description='the entry: {key}, or just key')}


def _key(config: NodeConfig) -> str:
    given = config.values['entry']
    return given.text if given.key is None else given.key


def _updated(node: UpdateDecorator | WasEntryUpdated) -> bool:
    """Whether the entry was written since the node has last seen so. One that is missing was not."""
    entry = node._entry
    if not entry.present:
        node._entry = entry = node.blackboard.entry(node._key) or MISSING
    writes = entry.sequence
    if writes == node._seen or entry is MISSING:
        return False
    node._seen = writes
    return True


class UpdateDecorator(DecoratorNode):
    """Ticks the child when the entry was written since the last time, and then until the child is no longer RUNNING."""

    __slots__ = ('_child_running', '_entry', '_key', '_seen')

    running_at_completion = None
    ports = _PORTS

    def __init__(self, config: NodeConfig) -> None:
        super().__init__(config)
        self._key = _key(config)
        self._entry = MISSING
        # The number of writes that was seen last.
        self._seen = 0
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


class SkipUnlessUpdated(UpdateDecorator):
    """Runs the child when ``entry`` was written since the last time; SKIPPED otherwise. A halt does not undo that."""

    __slots__ = ()

    example = Example(
        """
        <Repeat num_cycles="2">
          <Fallback>
            <SkipUnlessUpdated entry="{goal}"><Script code="n += 1"/></SkipUnlessUpdated>
            <AlwaysSuccess/>
          </Fallback>
        </Repeat>
        """,
        ticks=(RUNNING, SUCCESS),
        before={'n': 0, 'goal': 'dock'},
        after={'n': 1},
    )

    def execute(self) -> NodeStatus:
        # Nothing new is what most ticks find; a call would take longer than that.
        if not self._child_running and (self._entry.sequence == self._seen or not _updated(self)):
            return SKIPPED
        return self._run()


class WaitValueUpdate(UpdateDecorator):
    """Waits, RUNNING, until ``entry`` is written, and then runs the child. A halt does not undo what was seen.

    The write itself asks for no wake-up: what makes it, a leaf of the tree or its host, has to tick the tree.
    """

    __slots__ = ()

    example = Example('<WaitValueUpdate entry="{goal}"><AlwaysSuccess/></WaitValueUpdate>', ticks=(RUNNING, RUNNING))

    def execute(self) -> NodeStatus:
        if not self._child_running and (self._entry.sequence == self._seen or not _updated(self)):
            self.status = RUNNING
            return RUNNING
        return self._run()


class WasEntryUpdated(LeafNode):
    """SUCCESS when ``entry`` was written since the last tick of this node; FAILURE when not, or when it is missing."""

    __slots__ = ('_entry', '_key', '_seen')

    kind = NodeKind.ACTION
    ports = _PORTS
    example = Example('<WasEntryUpdated entry="{goal}"/>', ticks=(SUCCESS, FAILURE), before={'goal': 'dock'})

    def __init__(self, config: NodeConfig) -> None:
        super().__init__(config)
        self._key = _key(config)
        self._entry = MISSING
        # The number of writes that was seen last.
        self._seen = 0

    def execute(self) -> NodeStatus:
        status = SUCCESS if _updated(self) else FAILURE
        self.status = status
        return status

    def failure_reason(self) -> str:
        return f'{self.id}: entry [{self._key}] was not written since the last tick'


NODES: Final = (SkipUnlessUpdated, WaitValueUpdate, WasEntryUpdated)
