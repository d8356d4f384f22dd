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
    """A node with children. The nodes of the engine derive from it; other nodes from :class:`Control`."""

    __slots__ = ('_failed', '_ticks', 'children')

    kind = NodeKind.CONTROL
    running_at_completion: ClassVar[bool | None] = True
    children_bounds: ClassVar[tuple[int, int | None]] = (1, None)
    """Minimum and maximum number of children."""
    tickable_with: ClassVar[tuple[int, int] | None] = None
    """Minimum and maximum number of children for a tick, if a node may be loaded with other numbers."""
    runs_several: ClassVar[bool] = False
    """True if several children may be RUNNING at once."""
    tries_all: ClassVar[bool] = False
    """True if it fails when no child succeeds, not when one fails."""

    def __init__(self, config: NodeConfig) -> None:
        super().__init__(config)
        self.children: tuple[TreeNode, ...] = ()
        self._ticks: tuple[Tick, ...] = ()
        self._failed: int | None = None

    def attach(self, children: Sequence[TreeNode]) -> None:
        """Set the children, while the tree is built."""
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
        """Fetch the tick functions of the children, which may have changed."""
        self._ticks = tuple(tick_function(child) for child in self.children)

    def reset_children(self) -> None:
        """Halt the RUNNING children, and set all to IDLE, in order."""
        for child in self.children:
            if child.stored_status is RUNNING:
                child.halt_node()
            child.status = IDLE

    def halt_children_except(self, index: int) -> None:
        """Halt the RUNNING children, and set all to IDLE, except the child ``index``."""
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
        """Return the index of the last child with status FAILURE; None if no child has it."""
        failed = [index for index, child in enumerate(self.children) if child.stored_status is FAILURE]
        return failed[-1] if failed else None


class _UserParent(TreeNode):
    """Common base of user-defined controls and decorators."""

    __slots__ = ()

    running_at_completion: ClassVar[bool | None] = None

    def on_halt(self) -> None:
        """Clean up when the node is halted while RUNNING, before its children are halted.

        To drop state on a halt in any status, even IDLE, override :meth:`halt`: at the end of each run a tree halts all
        of its nodes, as in BehaviorTree.CPP.
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
    """The base of user-defined controls: implement :meth:`tick`, and :meth:`on_halt` if a halt must drop state."""

    __slots__ = ()

    @property
    def awaits_request(self) -> bool:
        """True while the node is RUNNING only until a request from outside the tree, which then wakes the tree."""
        return False

    @abstractmethod
    def tick(self) -> NodeStatus:
        """Tick the node: tick children by :meth:`tick_child`, and return the status."""

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


# Nodes with one child, and the base of user-defined decorators.
#
# A decorator sets its child to IDLE as soon as the child completes.


class DecoratorNode(TreeNode):
    """A node with one child. The nodes of the engine derive from it; other nodes from :class:`Decorator`."""

    __slots__ = ('_tick', 'child')

    kind = NodeKind.DECORATOR

    running_at_completion: ClassVar[bool | None] = True
    child: TreeNode
    _tick: Tick

    def attach(self, children: Sequence[TreeNode]) -> None:
        """Set the child, while the tree is built."""
        (self.child,) = children
        self.fetch_ticks()

    @property
    def attached(self) -> tuple[TreeNode, ...]:
        return (self.child,)

    def fetch_ticks(self) -> None:
        """Fetch the tick function of the child, which may have changed."""
        self._tick = tick_function(self.child)

    def halt(self) -> None:
        halt_child(self.child)
        self.status = IDLE

    def failure_cause(self) -> TreeNode | None:
        return self.child

    def failure_reason(self) -> str:
        return super().failure_reason() if self.failure_cause() is None else f'{self.id}: the child failed'


class Decorator(_UserParent, DecoratorNode):
    """The base of user-defined decorators: implement :meth:`tick`, and :meth:`on_halt` if a halt must drop state."""

    __slots__ = ('_child_failed',)

    def __init__(self, config: NodeConfig) -> None:
        super().__init__(config)
        self._child_failed = False

    @abstractmethod
    def tick(self) -> NodeStatus:
        """Tick the node: tick the child by :meth:`tick_child` or not, and return the status."""

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
