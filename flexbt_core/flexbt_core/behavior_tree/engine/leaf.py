# SPDX-License-Identifier: BSD-3-Clause
"""The bases of leaves: implement one, declare its ports, register it."""

from __future__ import annotations

from abc import abstractmethod
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
    TickAbandoned,
)
from flexbt_core.clock import Clock, WakeEvent
from flexbt_core.skills import Skill

from .node import NodeConfig, TreeNode


class Halted(BaseException):
    """Raised where the work of a leaf waits, in a thread or a coroutine, when the leaf was halted. Let it pass."""


class LeafNode(TreeNode):
    """A node without children.

    While the tree is paused its leaves are not ticked. What a leaf has begun elsewhere (a goal, a motor) has to stand
    still too: it says how by :meth:`on_pause` and :meth:`on_resume`. One whose work is all done in its ticks, or that
    only waits, says so by ``goes_on = ''``; of any other it is told that it goes on, and why.
    """

    __slots__ = ('_reason',)

    goes_on: ClassVar[str] = 'it does not declare how it is paused'
    """Why the work of this leaf goes on while the tree is paused; '' when there is none that could."""

    skill: ClassVar[Skill] = Skill()
    """What the leaf needs and brings about, beyond what its ports and statuses tell; see ``flexbt_core.skills``."""

    acts_later: ClassVar[bool] = False
    """Whether the leaf has its actuators only from when it calls :meth:`acts`, and not as soon as it is RUNNING."""

    begins_without: ClassVar[tuple[str, ...]] = ()
    """Outputs that a run begins without, unless they are among its inputs: what an earlier run has left there was for
    another goal. Its host empties them (:meth:`Tree.empty_outputs`)."""

    def __init__(self, config: NodeConfig) -> None:
        super().__init__(config)
        self._reason = ''

    @property
    def is_informed(self) -> bool:
        """Whether the last tick knew what the leaf answers by. False: no message had come yet, and the result may be
        another one in a moment."""
        return True

    def acts(self) -> None:
        """What the leaf does elsewhere begins: a goal is sent. A monitor checks that it may."""
        monitor = self.context.monitor
        if monitor is not None:
            monitor.acts(self)

    def wait_in_tick(self, event: WakeEvent, clock: Clock, until: float) -> None:
        """Hold up the tick until ``event`` is set, or ``clock`` shows ``until``.

        For an answer that the leaf needs within this tick and that comes soon: nothing else of the tree is ticked
        meanwhile. A cancel of the tree ends the wait.

        Raises:
            TickAbandoned: the tree is to be stopped; let it pass.
        """
        self.context.wait(event, clock, until)
        if self.context.stopping:
            raise TickAbandoned(self.path, self.id, 'the tree was stopped while this node waited for an answer')

    def fail(self, reason: str) -> NodeStatus:
        """FAILURE, with a reason for people: ``return self.fail('no path to the goal')``."""
        self._reason = reason
        return FAILURE

    def failure_reason(self) -> str:
        return self._reason or super().failure_reason()

    def on_pause(self) -> str:
        """The tree is paused while the leaf is RUNNING: have what it has begun stand still. Must not block.

        Gives why something goes on all the same, for people; ''. It may be called again in the same pause, after a
        step. A pause ends by :meth:`on_resume`, or by a halt.
        """
        return self.goes_on

    def on_resume(self) -> None:
        """The tree goes on; the next tick follows. Must not block."""

    def empty_output(self, port: str) -> None:
        """Write the value of its type that says nothing, such as a path without poses."""
        kind = self.ports[port].type
        self.set_output(port, None if kind is None else kind.python_type())

    def abandon(self) -> None:
        """The thread that ticks the tree does not come back: end what was begun elsewhere. On another thread."""


class SyncAction(LeafNode):
    """An action that is done within one tick: :meth:`tick` gives SUCCESS, FAILURE or SKIPPED, never RUNNING."""

    __slots__ = ()

    goes_on = ''

    kind = NodeKind.ACTION

    @abstractmethod
    def tick(self) -> NodeStatus:
        """Does the work."""

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


class Condition(LeafNode):
    """A test: :meth:`tick` gives SUCCESS when it holds and FAILURE when not."""

    __slots__ = ()

    goes_on = ''

    kind = NodeKind.CONDITION

    @abstractmethod
    def tick(self) -> NodeStatus:
        """Tests the condition. It must not change anything that other nodes see."""

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
        elif status is not SKIPPED:
            self.status = self.checked(status)
        return status


class StatefulAction(LeafNode):
    """An action that takes time and never blocks.

    ``on_start`` begins the work; while the node is RUNNING, ``on_running`` asks how it is; ``on_halted`` stops it.
    Work that goes on elsewhere calls ``self.wake()`` (from any thread) when its result may change; work that takes time
    asks for its next tick by ``self.wake_at``. Work that outlives the halt is registered by
    ``self.context.add_unfinished``.
    """

    __slots__ = ()

    kind = NodeKind.ACTION
    answers_soon: ClassVar[bool] = False
    """Whether it has its result in the tick in which it begins, wherever what it asks answers at once."""

    @abstractmethod
    def on_start(self) -> NodeStatus:
        """Begins the work: RUNNING when it goes on, or its result."""

    @abstractmethod
    def on_running(self) -> NodeStatus:
        """RUNNING, or the result of the work."""

    @abstractmethod
    def on_halted(self) -> None:
        """Stops the work that is RUNNING. Must not block."""

    def execute(self) -> NodeStatus:
        before = self.status
        if before is not IDLE and before is not RUNNING:
            # Completed, and not set back by the parent yet: the result stands.
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
            self.status = status  # first, so that what was begun is stopped where it is refused
        else:
            self.cancel_wake()
            if status is SKIPPED:
                return status
        self.status = self.checked(status)
        return status

    def halt(self) -> None:
        if self.status is RUNNING:
            self.cancel_wake()
            self.stop_by(self.on_halted)
        self.status = IDLE
