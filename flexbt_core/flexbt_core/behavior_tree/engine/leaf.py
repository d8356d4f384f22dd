# SPDX-License-Identifier: BSD-3-Clause
"""Base classes of leaves: implement one, declare its ports, register it."""

from __future__ import annotations

from abc import abstractmethod
from typing import ClassVar, NamedTuple

from flexbt_core.behavior_tree.model.blackboard import Blackboard
from flexbt_core.behavior_tree.model.definition import TreeKey, TreeLibrary
from flexbt_core.behavior_tree.model.errors import NodeExecutionError, TickAbandoned
from flexbt_core.behavior_tree.model.status import FAILURE, IDLE, RUNNING, SKIPPED, SUCCESS, NodeKind, NodeStatus
from flexbt_core.clock.clock import Clock
from flexbt_core.clock.waiting import WakeEvent
from flexbt_core.skills.skill import Skill

from .context import Tick
from .node import NodeConfig, TreeNode, halt_child, tick_function


class Halted(BaseException):
    """An exception raised where the thread or coroutine of a halted leaf waits. Do not catch it."""


class LeafNode(TreeNode):
    """A node without children.

    A paused tree does not tick its leaves. Work that a leaf has started outside the tree (a goal, a motor) must pause
    too: implement :meth:`on_pause` and :meth:`on_resume`. A leaf that does all its work in its ticks, or only waits,
    declares ``goes_on = ''``. For any other leaf the pause reports that its work continues, and why.
    """

    __slots__ = ('_reason',)

    goes_on: ClassVar[str] = 'it does not declare how it is paused'
    """Reason why the work of this leaf continues while the tree is paused; '' if none continues."""

    skill: ClassVar[Skill] = Skill()
    """Needs and effects of the leaf, in addition to its ports and statuses; see ``flexbt_core.skills``."""

    acts_later: ClassVar[bool] = False
    """True if the leaf uses its actuators only after it calls :meth:`acts`, not as soon as it is RUNNING."""

    begins_without: ClassVar[tuple[str, ...]] = ()
    """Outputs that the host empties before a run, unless they are among its inputs: values from an earlier run were for
    another goal. See :meth:`Tree.empty_outputs`."""

    def __init__(self, config: NodeConfig) -> None:
        super().__init__(config)
        self._reason = ''

    @property
    def is_informed(self) -> bool:
        """True if the last tick had the data for its result. False: no message had arrived yet, and the result may
        change soon."""
        return True

    def acts(self) -> None:
        """Report that the leaf starts work outside the tree, such as a goal. A monitor checks that it may."""
        monitor = self.context.monitor
        if monitor is not None:
            monitor.acts(self)

    def wait_in_tick(self, event: WakeEvent, clock: Clock, until: float) -> None:
        """Block the tick until ``event`` is set, or ``clock`` shows ``until``.

        Use it for an answer that the leaf needs within this tick and expects soon: no other node is ticked meanwhile.
        A cancel of the tree ends the wait.

        Raises:
            TickAbandoned: the host wants to stop the tree; do not catch it.
        """
        self.context.wait(event, clock, until)
        if self.context.stopping:
            raise TickAbandoned(self.path, self.id, 'the tree was stopped while this node waited for an answer')

    def fail(self, reason: str) -> NodeStatus:
        """Return FAILURE and store a reason for the user: ``return self.fail('no path to the goal')``."""
        self._reason = reason
        return FAILURE

    def failure_reason(self) -> str:
        return self._reason or super().failure_reason()

    def on_pause(self) -> str:
        """Pause the work that the leaf has started; called when the tree pauses while the leaf is RUNNING.

        Return why work continues, as text for the user; '' if none does. Must not block. The tree may call it again in
        the same pause, after a step. A pause ends by :meth:`on_resume`, or by a halt.
        """
        return self.goes_on

    def on_resume(self) -> None:
        """Resume the work; the next tick follows. Must not block."""

    def empty_output(self, port: str) -> None:
        """Write the empty value of the type of the port, such as a path without poses."""
        kind = self.ports[port].type
        assert kind is not None  # so it was registered
        self.set_output(port, kind.python_type())

    def abandon(self) -> None:
        """End work started outside the tree, because the ticking thread hangs. Called on another thread."""


class _InstantLeaf(LeafNode):
    """A leaf whose every tick returns a result."""

    __slots__ = ()

    goes_on = ''

    @abstractmethod
    def tick(self) -> NodeStatus:
        """Return the result."""

    def execute(self) -> NodeStatus:
        self._reason = ''
        try:
            status = self.tick()
        except NodeExecutionError:
            raise
        except BaseException as error:
            raise self.fault(error) from error
        if status is SUCCESS or status is FAILURE:
            self.status = status
        elif self.checked(status) is RUNNING:
            raise self.fault(
                'a synchronous action must not return RUNNING; use StatefulAction for work that takes time'
            )
        return status


class SyncAction(_InstantLeaf):
    """An action that completes in one tick: :meth:`tick` returns SUCCESS, FAILURE or SKIPPED, never RUNNING."""

    __slots__ = ()

    kind = NodeKind.ACTION


class Condition(_InstantLeaf):
    """A test: :meth:`tick` returns SUCCESS if it holds and FAILURE if not.

    It must not change anything that other nodes can read.
    """

    __slots__ = ()

    kind = NodeKind.CONDITION


class StatefulAction(LeafNode):
    """An action that takes time and never blocks.

    ``on_start`` starts the work; while the node is RUNNING, ``on_running`` checks it; ``on_halted`` stops it. Work
    outside the tree calls ``self.wake()`` (from any thread) when its result may change; work that takes time requests
    its next tick by ``self.wake_at``. Register work that outlives the halt with ``self.context.add_unfinished``.
    """

    __slots__ = ()

    kind = NodeKind.ACTION
    answers_soon: ClassVar[bool] = False
    """True if the tick that starts it returns its result, provided that its source answers at once."""

    @abstractmethod
    def on_start(self) -> NodeStatus:
        """Start the work; return RUNNING while it continues, or its result."""

    @abstractmethod
    def on_running(self) -> NodeStatus:
        """Return RUNNING, or the result of the work."""

    @abstractmethod
    def on_halted(self) -> None:
        """Stop the work that is RUNNING. Must not block."""

    def execute(self) -> NodeStatus:
        before = self.stored_status
        if before is not IDLE and before is not RUNNING:
            # Completed, and not reset by the parent yet: keep the result.
            return before
        try:
            if before is IDLE:
                self._reason = ''
                status = self.on_start()
            else:
                status = self.on_running()
        except NodeExecutionError:  # of a node below, see ExpandingAction
            self.cancel_wake()
            raise
        except BaseException as error:
            self.cancel_wake()
            raise self.fault(error) from error
        if status is RUNNING:
            if before is IDLE:
                self.status = status  # first, so that a halt stops the work if the status is refused
            return self.checked(status)
        self.cancel_wake()
        if status is not SKIPPED:
            self.status = self.checked(status)
        return status

    def halt(self) -> None:
        if self.stored_status is RUNNING:
            self.cancel_wake()
            self.stop_by(self.on_halted)
        self.status = IDLE


# The base of actions that make a tree below them while they run, such as that of a plan.


class Expansion(NamedTuple):
    """A tree to make below a node, and the blackboard of its nodes."""

    library: TreeLibrary
    key: TreeKey
    blackboard: Blackboard


class ExpandingAction(StatefulAction):
    """An action whose tree is made while it runs. ::

        def on_start(self):
            return self.expand(library, 'Way', Blackboard(self.blackboard))

        def on_running(self):
            return self.tick_tree()

    The nodes of that tree are part of the running tree, as those of a sub-tree: ticked, halted, paused and resumed with
    it, and reported to its observers (:meth:`Tree.observe`). Each tree replaces the previous one.
    """

    __slots__ = ('_error', '_root', '_tick')

    goes_on = ''

    def __init__(self, config: NodeConfig) -> None:
        super().__init__(config)
        self._root: TreeNode | None = None
        self._tick: Tick | None = None
        self._error: Exception | None = None

    def expand(self, library: TreeLibrary, tree_id: str, blackboard: Blackboard) -> NodeStatus:
        """Request a tree, which is ready at the next tick of this node, wake the tree for it, and return RUNNING.

        Raises LookupError if the library does not have the tree.
        """
        key = library.find(tree_id)
        if key is None:
            raise LookupError(f'there is no tree [{tree_id}] to be made below [{self.path}]')
        self._halt_tree()
        self._error = None
        self.context.expansions[self] = Expansion(library, key, blackboard)
        self.wake()
        return RUNNING

    def tick_tree(self) -> NodeStatus:
        """Tick the tree; return RUNNING until it is ready.

        Raises the error that prevented making the tree: TreeLoadError if it does not fit its blackboard.
        """
        if self._error is not None:
            raise self._error
        if self._tick is None or self in self.context.expansions:
            return RUNNING
        status = self._tick()
        root = self._root
        if root is not None and (root.stored_status is SUCCESS or root.stored_status is FAILURE):
            root.status = IDLE
        return status

    def adopt(self, root: TreeNode | None, error: Exception | None = None) -> None:
        """Store the root of the new tree, or the error that prevented making it."""
        self._root = root
        self._error = error
        self.fetch_ticks()

    def fetch_ticks(self) -> None:
        """Fetch the tick function of the root of the tree, which may have changed."""
        self._tick = None if self._root is None else tick_function(self._root)

    @property
    def attached(self) -> tuple[TreeNode, ...]:
        return () if self._root is None else (self._root,)

    def halt(self) -> None:
        super().halt()
        self._halt_tree()

    def _halt_tree(self) -> None:
        self.context.expansions.pop(self, None)
        if self._root is not None:
            halt_child(self._root)
