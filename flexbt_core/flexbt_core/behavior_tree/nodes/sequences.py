# SPDX-License-Identifier: BSD-3-Clause
"""Sequence and Fallback, with memory, reactive and asynchronous; TryCatch, a sequence that cleans up after itself.

A sequence ends with the first child that fails, a fallback with the first that succeeds. Otherwise both continue with
the next child, and the next tick starts with the RUNNING child. Both pass over skipped children; a node is skipped if
all its children were skipped.
"""

from __future__ import annotations

from operator import length_hint
from typing import ClassVar, Final

from flexbt_core.behavior_tree.engine.node import NodeConfig, halt_child
from flexbt_core.behavior_tree.engine.parents import ControlNode
from flexbt_core.behavior_tree.model.outcomes import Example, InOrder
from flexbt_core.behavior_tree.model.ports import BOOL, input_port
from flexbt_core.behavior_tree.model.status import FAILURE, IDLE, RUNNING, SKIPPED, SUCCESS, NodeStatus


class _OrderedControl(ControlNode):
    """A control that keeps its position within the children from tick to tick.

    ``passing`` is the status after which the next child is tried.
    """

    __slots__ = ('_index', '_passing', '_skipped')

    passing: ClassVar[NodeStatus]

    def __init__(self, config: NodeConfig) -> None:
        super().__init__(config)
        self._index = 0
        self._skipped = 0
        self._passing = self.passing  # Python reads a slot sooner than an attribute of the class

    def halt(self) -> None:
        self._index = self._skipped = 0
        super().halt()

    def _finish(self, status: NodeStatus) -> NodeStatus:
        """Rewind after the last child; return ``status``, or SKIPPED if all children were skipped."""
        all_skipped = self._skipped == len(self.children)
        self.reset_children()
        self._index = self._skipped = 0
        if all_skipped:
            return SKIPPED
        self.status = status
        return status


class _SteadyControl(_OrderedControl):
    """A control that ticks the next child within the same tick."""

    __slots__ = ()

    def execute(self) -> NodeStatus:
        before = self.stored_status
        if before is not RUNNING:  # in a watched tree even storing an unchanged status costs time
            if before is IDLE:
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
                        # The position is rarely needed, so the loop does not count it.
                        self._index = len(ticks) - length_hint(remaining) - 1
                        return RUNNING
                    break
        except BaseException:
            self._index = len(ticks) - length_hint(remaining) - 1
            raise
        if status is passing or status is SKIPPED:
            if passing is FAILURE:
                self._failed = self.last_failed() if self._skipped else -1
            if self._skipped:
                return self._finish(passing)
            # No child is RUNNING: one that is would have been skipped.
            for child in self.children:
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

    passing = SUCCESS
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
    passing = FAILURE
    outcomes = InOrder(passing=FAILURE)
    example = Example(
        """
        <Fallback><AlwaysFailure/><Script code="used := 'second'"/><Script code="used := 'third'"/></Fallback>
        """,
        ticks=(SUCCESS,),
        after={'used': 'second'},
    )


class _YieldingControl(_OrderedControl):
    """A control that yields (returns RUNNING and wakes the tree) after each child that completes in its first tick.

    So the rest of the tree is ticked between two children.
    """

    __slots__ = ()

    def execute(self) -> NodeStatus:
        before = self.stored_status
        if before is not RUNNING:  # in a watched tree even storing an unchanged status costs time
            if before is IDLE:
                self._skipped = 0
            self.status = RUNNING
        children = self.children
        ticks = self._ticks
        passing = self._passing
        index = self._index
        for tick in ticks[index:] if index else ticks:
            was_idle = children[index].stored_status is IDLE
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
        # Inlined reset_children.
        for child in self.children:
            if child.stored_status is RUNNING:
                child.halt_node()
            child.status = IDLE
        self._index = 0
        self.status = passing
        return passing

    def _stop(self, status: NodeStatus) -> NodeStatus:
        """Rewind and return ``status``, with which a child ends the node."""
        self._failed = self._index
        self._index = 0
        self.reset_children()
        self.status = status
        return status


class AsyncSequence(_YieldingControl):
    """A Sequence that yields between two children, so that the rest of the tree is ticked."""

    __slots__ = ()

    passing = SUCCESS
    outcomes = InOrder(passing=SUCCESS, yields=True)
    example = Example(
        '<AsyncSequence><Script code="a := 1"/><Script code="a := 2"/></AsyncSequence>',
        ticks=(RUNNING, SUCCESS),
        after={'a': 2},
    )


class AsyncFallback(_YieldingControl):
    """A Fallback that yields between two children, so that the rest of the tree is ticked."""

    __slots__ = ()

    tries_all = True
    passing = FAILURE
    outcomes = InOrder(passing=FAILURE, yields=True)
    example = Example('<AsyncFallback><AlwaysFailure/><AlwaysSuccess/></AsyncFallback>', ticks=(RUNNING, SUCCESS))


class SequenceWithMemory(_YieldingControl):
    """A Sequence that, after a failure or a halt, continues with the child at which it stopped.

    It starts with the first child again only after all have succeeded. It yields as AsyncSequence does.
    """

    __slots__ = ()

    passing = SUCCESS
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


# ReactiveSequence and ReactiveFallback: every tick begins with the first child.
#
# While one child is RUNNING, the node halts all others, before and after it, and sets them to IDLE. It also sets a
# skipped child to IDLE.


class _ReactiveControl(ControlNode):
    __slots__ = ()

    passing: ClassVar[NodeStatus]

    def execute(self) -> NodeStatus:
        if self.stored_status is not RUNNING:
            self.status = RUNNING
        passing = self.passing
        ticks = self._ticks
        skipped = 0
        remaining = iter(ticks)
        for tick in remaining:
            status = tick()
            if status is not passing:
                index = len(ticks) - length_hint(remaining) - 1
                if status is SKIPPED:
                    skipped += 1
                    halt_child(self.children[index])
                    continue
                if status is RUNNING:
                    self.halt_children_except(index)
                    return RUNNING
                self._failed = index
                self.reset_children()
                self.status = status
                return status
        if passing is FAILURE:
            self._failed = self.last_failed() if skipped else len(ticks) - 1
        self.reset_children()
        if skipped == len(ticks):
            return SKIPPED
        self.status = passing
        return passing


class ReactiveSequence(_ReactiveControl):
    """SUCCESS if all children succeed within one tick; FAILURE as soon as one fails, which halts the RUNNING child."""

    __slots__ = ()

    passing = SUCCESS
    outcomes = InOrder(passing=SUCCESS)
    example = Example(
        """
        <ReactiveSequence>
          <ScriptCondition code="(asked += 1) > 0"/>
          <Sleep msec="100"/>
        </ReactiveSequence>
        """,
        ticks=(RUNNING, SUCCESS),
        before={'asked': 0},
        after={'asked': 2},
    )


class ReactiveFallback(_ReactiveControl):
    """SUCCESS as soon as a child succeeds, which halts the RUNNING child; FAILURE if all fail within one tick."""

    __slots__ = ()

    tries_all = True
    passing = FAILURE
    outcomes = InOrder(passing=FAILURE)
    example = Example(
        """
        <ReactiveFallback>
          <ScriptCondition code="(asked += 1) == 2"/>
          <Sleep msec="100"/>
        </ReactiveFallback>
        """,
        ticks=(RUNNING, SUCCESS),
        before={'asked': 0},
    )


# TryCatch: a sequence that cleans up after itself.


class TryCatch(ControlNode):
    """Runs all children but the last as a Sequence; if one fails, runs the last, the clean-up, and returns FAILURE.

    The node fails whatever the result of the clean-up. With ``catch_on_halt``, a halt of the sequence also ticks the
    clean-up once, and halts it if it does not complete in this tick. SKIPPED if all children of the sequence were
    skipped.
    """

    __slots__ = ('_catching', '_index', '_skipped')

    ports = {
        'catch_on_halt': input_port(BOOL, default='false', description='whether a halt ticks the last child, too'),
    }
    children_bounds = (2, None)
    example = Example(
        """
        <TryCatch><Sequence><AlwaysSuccess/><AlwaysFailure/></Sequence><Script code="repaired := true"/></TryCatch>
        """,
        ticks=(FAILURE,),
        after={'repaired': True},
    )

    def __init__(self, config: NodeConfig) -> None:
        super().__init__(config)
        self._index = 0
        self._skipped = 0
        self._catching = False

    def execute(self) -> NodeStatus:
        if self.stored_status is IDLE:
            self._skipped = 0
            self._catching = False
        self.status = RUNNING
        if not self._catching:
            status = self._try()
            if status is not FAILURE:
                return status
        status = self._ticks[-1]()
        if status is RUNNING:
            return RUNNING
        self.reset_children()
        self._catching = False
        self.status = FAILURE
        return FAILURE

    def _try(self) -> NodeStatus:
        """Continue the sequence. FAILURE ends it, and the clean-up follows."""
        ticks = self._ticks
        index = self._index
        last = len(ticks) - 1
        while index < last:
            status = ticks[index]()
            if status is RUNNING:
                return RUNNING
            if status is FAILURE:
                self._failed = index
                self._index = 0
                self._catching = True
                self.reset_children()
                return FAILURE
            if status is SKIPPED:
                self._skipped += 1
            # Stored at each step, so that the node continues with a child that raises.
            self._index = index = index + 1
        all_skipped = self._skipped == last
        self._index = self._skipped = 0
        self.reset_children()
        if all_skipped:
            return SKIPPED
        self.status = SUCCESS
        return SUCCESS

    def failure_reason(self) -> str:
        return f'{super().failure_reason()}; [{self.children[-1].path}] has cleaned up'

    def halt(self) -> None:
        if self.stored_status is RUNNING and not self._catching:
            self.stop_by(self._catch_the_halt)
        self._index = self._skipped = 0
        self._catching = False
        super().halt()

    def _catch_the_halt(self) -> None:
        if self.get_input_or('catch_on_halt', False):
            for child in self.children[:-1]:
                halt_child(child)
            context = self.context
            context.stopping = False  # the clean-up is part of a stop, and may take its time
            try:
                self._ticks[-1]()
            finally:
                context.stopping = context.stop_requested


NODES: Final = (
    Sequence,
    AsyncSequence,
    SequenceWithMemory,
    Fallback,
    AsyncFallback,
    ReactiveSequence,
    ReactiveFallback,
    TryCatch,
)
