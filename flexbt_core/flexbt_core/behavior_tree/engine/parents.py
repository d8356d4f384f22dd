# SPDX-License-Identifier: BSD-3-Clause
"""Base classes of nodes with children: controls with several, decorators with one.

A control keeps the statuses of its completed children until it completes itself.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Sequence
from typing import ClassVar

from flexbt_core.behavior_tree.model.errors import NodeExecutionError
from flexbt_core.behavior_tree.model.status import FAILURE, IDLE, RUNNING, SKIPPED, SUCCESS, NodeKind, NodeStatus

from .context import Tick
from .node import NodeConfig, TreeNode, halt_child, tick_function


class ControlNode(TreeNode):
    """A node with children. The nodes of the engine derive from it; others from :class:`Control`."""

    __slots__ = ('_failed', '_ticks', 'children')

    kind = NodeKind.CONTROL
    running_at_completion: ClassVar[bool | None] = True
    children_bounds: ClassVar[tuple[int, int | None]] = (1, None)
    """Least and greatest number of children."""
    tickable_with: ClassVar[tuple[int, int] | None] = None
    """Least and greatest number of children with which it can be ticked, if it is loaded with others as well."""
    runs_several: ClassVar[bool] = False
    """True if several children may be RUNNING at once."""
    tries_all: ClassVar[bool] = False
    """True if it fails because no child succeeds, not because one fails."""

    def __init__(self, config: NodeConfig) -> None:
        super().__init__(config)
        self.children: tuple[TreeNode, ...] = ()
        self._ticks: tuple[Tick, ...] = ()
        self._failed: int | None = None

    def attach(self, children: Sequence[TreeNode]) -> None:
        """Take the children, while the tree is being built."""
        self.children = tuple(children)
        self.fetch_ticks()

    @classmethod
    def incompleteness(cls, count: int) -> str:
        """Return why it cannot be ticked with this many children; '' if it can."""
        if cls.tickable_with is None:
            return ''
        least, most = cls.tickable_with
        if least <= count <= most:
            return ''
        wanted = f'{least}' if least == most else f'{least} to {most}'
        return f'{cls.__name__} has {wanted} children, not {count}'

    @property
    def attached(self) -> tuple[TreeNode, ...]:
        return self.children

    def fetch_ticks(self) -> None:
        """Fetch the callables by which the children are ticked; some of them may have been exchanged."""
        self._ticks = tuple(tick_function(child) for child in self.children)

    def reset_children(self) -> None:
        """Halt the children that are RUNNING, and sets all to IDLE, in their order."""
        for child in self.children:
            if child.stored_status is RUNNING:
                child.halt_node()
            child.status = IDLE

    def halt_children_except(self, index: int) -> None:
        """As :meth:`reset_children`, for all children but one."""
        for position, child in enumerate(self.children):
            if position != index:
                halt_child(child)

    def halt(self) -> None:
        self.reset_children()
        self.status = IDLE

    def failure_cause(self) -> TreeNode | None:
        return None if self._failed is None else self.children[self._failed]

    def failure_reason(self) -> str:
        if self._failed is None:
            return super().failure_reason()
        total = len(self.children)
        if self.tries_all:
            return f'{self.id}: none of {total} children succeeded'
        return f'{self.id}: child {self._failed + 1} of {total} failed'

    def last_failed(self) -> int | None:
        """Return the last child that has FAILURE still."""
        failed = [index for index, child in enumerate(self.children) if child.stored_status is FAILURE]
        return failed[-1] if failed else None


class _UserParent(TreeNode):
    """What the bases of your own controls and decorators have in common."""

    __slots__ = ()

    running_at_completion: ClassVar[bool | None] = None

    def on_halt(self) -> None:
        """Clean up when the node is halted while it is RUNNING, before its children are.

        What a halt has to drop from any node, also from one that is IDLE, is for :meth:`halt`: at the end of each run
        a tree halts all of its nodes, as in BehaviorTree.CPP.
        """

    @property
    def active(self) -> bool:
        """True if the node has been ticked since it was last set to IDLE. False in the first tick of a run."""
        return self.stored_status is not IDLE

    def halt(self) -> None:
        if self.stored_status is RUNNING:
            self.stop_by(self.on_halt)
        super().halt()


class Control(_UserParent, ControlNode):
    """The base of your own controls: implement :meth:`tick`, and :meth:`on_halt` when there is state to drop."""

    __slots__ = ()

    @abstractmethod
    def tick(self) -> NodeStatus:
        """One tick; ticks children by :meth:`tick_child`."""

    def tick_child(self, index: int) -> NodeStatus:
        status = self._ticks[index]()
        if status is FAILURE:
            self._failed = index
        return status

    def halt_child(self, index: int) -> None:
        halt_child(self.children[index])

    def execute(self) -> NodeStatus:
        if self.stored_status is not RUNNING:
            self._failed = None
        try:
            status = self.tick()
        except NodeExecutionError:
            raise
        except BaseException as error:
            raise self.fault(error) from error
        if status is not SKIPPED and not (status is RUNNING and self.stored_status is RUNNING):
            self.status = self.checked(status)
        return status


# Nodes with one child, and the base of your own decorators.
#
# A decorator sets its child back to IDLE as soon as that has completed.


class DecoratorNode(TreeNode):
    """A node with one child. The nodes of the engine derive from it; others from :class:`Decorator`."""

    __slots__ = ('_tick', 'child')

    kind = NodeKind.DECORATOR

    running_at_completion: ClassVar[bool | None] = True
    child: TreeNode
    _tick: Tick

    def attach(self, children: Sequence[TreeNode]) -> None:
        """Take the child, while the tree is being built."""
        (self.child,) = children
        self.fetch_ticks()

    @property
    def attached(self) -> tuple[TreeNode, ...]:
        return (self.child,)

    def fetch_ticks(self) -> None:
        """Fetch the callable by which the child is ticked, which may have been exchanged."""
        self._tick = tick_function(self.child)

    def halt(self) -> None:
        halt_child(self.child)
        self.status = IDLE

    def failure_cause(self) -> TreeNode | None:
        return self.child

    def failure_reason(self) -> str:
        return super().failure_reason() if self.failure_cause() is None else f'{self.id}: the child failed'


class Decorator(_UserParent, DecoratorNode):
    """The base of your own decorators: implement :meth:`tick`, and :meth:`on_halt` when there is state to drop."""

    __slots__ = ('_child_failed',)

    def __init__(self, config: NodeConfig) -> None:
        super().__init__(config)
        self._child_failed = False

    @abstractmethod
    def tick(self) -> NodeStatus:
        """One tick; ticks the child by :meth:`tick_child` or not."""

    def tick_child(self) -> NodeStatus:
        status = self._tick()
        self._child_failed = status is FAILURE
        return status

    def halt_child(self) -> None:
        halt_child(self.child)

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
        if status is not SKIPPED and not (status is RUNNING and self.stored_status is RUNNING):
            self.status = self.checked(status)
        child = self.child
        if child.stored_status is SUCCESS or child.stored_status is FAILURE:
            child.status = IDLE
        return status
