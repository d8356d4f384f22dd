# SPDX-License-Identifier: BSD-3-Clause
"""Sequence and Fallback, and their variants that remember or that yield between children.

A sequence ends with the first child that fails, a fallback with the first that succeeds; both go on with the next
child otherwise, and begin a later tick with the child that was RUNNING. Skipped children count as passed; a node all of
whose children were skipped is skipped.
"""

from __future__ import annotations

from operator import length_hint
from typing import ClassVar, Final

from flexbt_core.behavior_tree.engine import ControlNode, NodeConfig, halt_child
from flexbt_core.behavior_tree.model import (
    FAILURE,
    IDLE,
    RUNNING,
    SKIPPED,
    SUCCESS,
    Example,
    InOrder,
    NodeStatus,
)


class _OrderedControl(ControlNode):
    """Position within the children, kept from tick to tick.

    ``_passing`` is the status after which the next child is tried.
    """

    __slots__ = ('_index', '_skipped')

    _passing: ClassVar[NodeStatus]

    def __init__(self, config: NodeConfig) -> None:
        super().__init__(config)
        self._index = 0
        self._skipped = 0

    def halt(self) -> None:
        self._index = self._skipped = 0
        super().halt()

    def _finish(self, status: NodeStatus) -> NodeStatus:
        """All children were passed: rewinds, and gives ``status`` unless they were all skipped."""
        all_skipped = self._skipped == len(self.children)
        self.reset_children()
        self._index = self._skipped = 0
        if all_skipped:
            return SKIPPED
        self.status = status
        return status


class _SteadyControl(_OrderedControl):
    """Ticks the next child within the same tick."""

    __slots__ = ()

    def execute(self) -> NodeStatus:
        if self.status is IDLE:
            self._skipped = 0
        self.status = RUNNING
        passing = self._passing
        ticks = self._ticks
        index = self._index
        remaining = iter(ticks[index:] if index else ticks)
        try:
            for tick in remaining:
                status = tick()
                if status is not passing:
                    if status is SKIPPED:
                        self._skipped += 1
                        continue
                    if status is RUNNING:
                        # The position is needed only now and then, so the loop does not count it.
                        self._index = len(ticks) - length_hint(remaining) - 1
                        return RUNNING
                    break
        except BaseException:
            self._index = len(ticks) - length_hint(remaining) - 1
            raise
        if status is passing or status is SKIPPED:
            if passing is FAILURE:
                self._failed = self.last_failed() if self._skipped else len(ticks) - 1
            if self._skipped:
                return self._finish(passing)
            # As reset_children does; a call would be much of the time that a short row takes.
            for child in self.children:
                if child.status is RUNNING:
                    child.halt_node()
                child.status = IDLE
            self._index = 0
            self.status = passing
            return passing
        if status is FAILURE:
            self._failed = len(ticks) - length_hint(remaining) - 1
        self._index = 0
        self.reset_children()
        self.status = status
        return status


class Sequence(_SteadyControl):
    """SUCCESS when all children succeed, in order; FAILURE at the first that fails."""

    __slots__ = ()

    _passing = SUCCESS
    outcomes = InOrder(passing=SUCCESS)
    example = Example(
        '<Sequence><Script code="a := 1"/><ScriptCondition code="a == 2"/><Script code="a := 3"/></Sequence>',
        ticks=(FAILURE,),
        after={'a': 1},
    )


class Fallback(_SteadyControl):
    """SUCCESS at the first child that succeeds, in order; FAILURE when all fail."""

    __slots__ = ()

    tries_all = True
    _passing = FAILURE
    outcomes = InOrder(passing=FAILURE)
    example = Example(
        """
        <Fallback><AlwaysFailure/><Script code="used := 'second'"/><Script code="used := 'third'"/></Fallback>
        """,
        ticks=(SUCCESS,),
        after={'used': 'second'},
    )


class _YieldingControl(_OrderedControl):
    """Returns RUNNING, and asks to be ticked again at once, after each child that began and completed in one tick.

    So the rest of the tree is ticked between two children.
    """

    __slots__ = ()

    def execute(self) -> NodeStatus:
        if self.status is IDLE:
            self._skipped = 0
        self.status = RUNNING
        children = self.children
        ticks = self._ticks
        passing = self._passing
        index = self._index
        for tick in ticks[index:] if index else ticks:
            was_idle = children[index].status is IDLE
            status = tick()
            if status is passing:
                if status is FAILURE:
                    self._failed = index
                self._index = index = index + 1
                if was_idle and index < len(ticks):
                    self.context.woken = True
                    return RUNNING
            elif status is RUNNING:
                return RUNNING
            elif status is SKIPPED:
                self._skipped += 1
                self._index = index = index + 1
            else:
                return self._stop(status)
        if self._skipped:
            return self._finish(passing)
        # As reset_children does.
        for child in self.children:
            if child.status is RUNNING:
                child.halt_node()
            child.status = IDLE
        self._index = 0
        self.status = passing
        return passing

    def _stop(self, status: NodeStatus) -> NodeStatus:
        """A child ended it all with ``status``."""
        self._failed = self._index
        self._index = 0
        self.reset_children()
        self.status = status
        return status


class AsyncSequence(_YieldingControl):
    """A Sequence that lets the rest of the tree be ticked between two children."""

    __slots__ = ()

    _passing = SUCCESS
    outcomes = InOrder(passing=SUCCESS, yields=True)
    example = Example(
        '<AsyncSequence><Script code="a := 1"/><Script code="a := 2"/></AsyncSequence>',
        ticks=(RUNNING, SUCCESS),
        after={'a': 2},
    )


class AsyncFallback(_YieldingControl):
    """A Fallback that lets the rest of the tree be ticked between two children."""

    __slots__ = ()

    tries_all = True
    _passing = FAILURE
    outcomes = InOrder(passing=FAILURE, yields=True)
    example = Example('<AsyncFallback><AlwaysFailure/><AlwaysSuccess/></AsyncFallback>', ticks=(RUNNING, SUCCESS))


class SequenceWithMemory(_YieldingControl):
    """A Sequence that, after a failure or a halt, goes on with the child at which it stopped.

    Only the success of all children makes it begin with the first one again. It yields as AsyncSequence does.
    """

    __slots__ = ()

    _passing = SUCCESS
    outcomes = InOrder(passing=SUCCESS, yields=True, remembers=True)
    example = Example(
        """
        <RetryUntilSuccessful num_attempts="3">
          <SequenceWithMemory>
            <Script code="begun += 1"/>
            <ScriptCondition code="(tries += 1) == 2"/>
          </SequenceWithMemory>
        </RetryUntilSuccessful>
        """,
        ticks=(RUNNING, SUCCESS),
        before={'begun': 0, 'tries': 0},
        after={'begun': 1, 'tries': 2},
    )

    def _stop(self, status: NodeStatus) -> NodeStatus:
        self._failed = self._index
        for child in self.children[self._index :]:
            halt_child(child)
        self.status = status
        return status

    def halt(self) -> None:
        self.reset_children()
        self.status = IDLE


NODES: Final = (Sequence, AsyncSequence, SequenceWithMemory, Fallback, AsyncFallback)
