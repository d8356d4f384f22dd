# SPDX-License-Identifier: BSD-3-Clause
"""Nodes with one child, and the base of those of one's own.

A decorator sets its child back to IDLE as soon as that has completed.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Sequence
from typing import ClassVar

from flexbt_core.behavior_tree.model import (
    FAILURE,
    IDLE,
    RUNNING,
    SKIPPED,
    SUCCESS,
    NodeExecutionError,
    NodeKind,
    NodeStatus,
)

from .context import Tick
from .node import NodeConfig, TreeNode
from .ticking import halt_child, tick_function


class DecoratorNode(TreeNode):
    """A node with one child. The nodes of the engine derive from it; others from :class:`Decorator`."""

    __slots__ = ('_tick', 'child')

    kind = NodeKind.DECORATOR

    running_at_completion: ClassVar[bool | None] = True
    child: TreeNode
    _tick: Tick

    def attach(self, children: Sequence[TreeNode]) -> None:
        """Takes the child, while the tree is being built."""
        (self.child,) = children
        self.fetch_ticks()

    @property
    def attached(self) -> tuple[TreeNode, ...]:
        return (self.child,)

    def fetch_ticks(self) -> None:
        """Fetches the callable by which the child is ticked, which may have been exchanged."""
        self._tick = tick_function(self.child)

    def halt(self) -> None:
        halt_child(self.child)
        self.status = IDLE

    def failure_cause(self) -> TreeNode | None:
        return self.child

    def failure_reason(self) -> str:
        return super().failure_reason() if self.failure_cause() is None else f'{self.id}: the child failed'


class Decorator(DecoratorNode):
    """Base of decorators of one's own: implement :meth:`tick`, and :meth:`on_halt` when there is state to drop."""

    __slots__ = ('_child_failed',)

    running_at_completion = None

    def __init__(self, config: NodeConfig) -> None:
        super().__init__(config)
        self._child_failed = False

    @abstractmethod
    def tick(self) -> NodeStatus:
        """One tick; ticks the child by :meth:`tick_child` or not."""

    def on_halt(self) -> None:
        """Called when the node is halted while it is RUNNING, before its child is; see :meth:`Control.on_halt`."""

    def tick_child(self) -> NodeStatus:
        status = self._tick()
        self._child_failed = status is FAILURE
        return status

    def halt_child(self) -> None:
        halt_child(self.child)

    @property
    def active(self) -> bool:
        """Whether the node has been ticked since it was last set to IDLE. False in the first tick of a run."""
        return self.status is not IDLE

    def failure_cause(self) -> TreeNode | None:
        return self.child if self._child_failed else None

    def execute(self) -> NodeStatus:
        self._child_failed = False
        try:
            status = self.tick()
        except NodeExecutionError:
            raise
        except BaseException as error:
            raise self.fault(error) from error
        if status is not SKIPPED:
            self.status = self.checked(status)
        child = self.child
        if child.status is SUCCESS or child.status is FAILURE:
            child.status = IDLE
        return status

    def halt(self) -> None:
        if self.status is RUNNING:
            self.stop_by(self.on_halt)
        super().halt()
