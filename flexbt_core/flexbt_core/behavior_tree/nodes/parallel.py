# SPDX-License-Identifier: BSD-3-Clause
"""Parallel and ParallelAll, which tick all children and count successes and failures."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Sequence
from operator import length_hint
from typing import Final

from flexbt_core.behavior_tree.engine.context import Tick
from flexbt_core.behavior_tree.engine.node import NodeConfig
from flexbt_core.behavior_tree.engine.parents import ControlNode
from flexbt_core.behavior_tree.model.outcomes import Example
from flexbt_core.behavior_tree.model.ports import INT, input_port
from flexbt_core.behavior_tree.model.status import FAILURE, IDLE, RUNNING, SKIPPED, SUCCESS, NodeStatus


def _completed() -> NodeStatus:
    """Replace the tick of a child that has completed."""
    return IDLE


class _ParallelControl(ControlNode):
    """A control that does not tick a completed child again until the node completes.

    Thresholds are ports, and may change from tick to tick; the node caches literal ones.
    """

    __slots__ = ('_counted', '_limits', '_row')

    runs_several = True

    def __init__(self, config: NodeConfig) -> None:
        super().__init__(config)
        # Number of failures when the node failed.
        self._counted = 0
        self._limits: tuple[int, ...] | None = None

    def fetch_ticks(self) -> None:
        super().fetch_ticks()
        self._strike_out()

    def _strike_out(self) -> None:
        """Build the list of tick functions, with a stub for each completed child."""
        pairs = zip(self._ticks, self.children, strict=True)
        self._row: Sequence[Tick] = [
            _completed if child.stored_status is SUCCESS or child.stored_status is FAILURE else tick
            for tick, child in pairs
        ]

    def failure_reason(self) -> str:
        limits = ', '.join(f'{port}="{self.port_text(port)}"' for port in self.ports)
        if self._failed is None:
            return f'{self.id}: no failure is one too many ({limits})'
        return f'{self.id}: {self._counted} of {len(self.children)} children failed ({limits})'

    @abstractmethod
    def _read_limits(self) -> tuple[int, ...]:
        """Return the thresholds from the ports."""

    def _current_limits(self) -> tuple[int, ...]:
        limits = self._read_limits()
        if all(self.port_key(port) is None for port in self.ports):
            self._limits = limits
        return limits

    def _limit(self, port: str, what: str) -> int:
        """Return a threshold as a number of children, 0 or more."""
        total = len(self.children)
        count: int = self.get_input(port)
        limit = count if count >= 0 else max(total + count + 1, 0)
        if limit > total:
            raise self.fault(f'{port} {count} is more than its {total} children: it can never {what}')
        return limit

    def _finish(self, status: NodeStatus) -> NodeStatus:
        self._row = self._ticks
        self.reset_children()
        self.status = status
        return status

    def halt(self) -> None:
        self._row = self._ticks
        super().halt()


class Parallel(_ParallelControl):
    """SUCCESS after ``success_count`` successes; FAILURE after ``failure_count`` failures, or if too few can succeed.

    A negative count is relative to the number of children (-1: all); skipped children then count as successes too. The
    node checks the thresholds after every child, so it may not tick later ones. It does not tick a completed child
    again until the node completes, but does tick a skipped one.
    """

    __slots__ = ('_failures', '_successes')

    ports = {
        'success_count': input_port(INT, default='-1', description='successes needed; negative: from the end'),
        'failure_count': input_port(INT, default='1', description='failures that end it; negative: from the end'),
    }
    example = Example(
        """
        <Parallel success_count="2" failure_count="2"><AlwaysSuccess/><AlwaysFailure/><Sleep msec="50"/></Parallel>
        """,
        ticks=(RUNNING, SUCCESS),
    )

    def __init__(self, config: NodeConfig) -> None:
        super().__init__(config)
        self._successes = self._failures = 0

    def execute(self) -> NodeStatus:
        needed, too_many, tolerant = self._limits or self._current_limits()
        if self.stored_status is not RUNNING:
            self.status = RUNNING
            self._failed = None
        row = self._row
        passed = before = self._successes
        failures = self._failures
        spare = len(row) - needed
        skipped = 0
        # The thresholds are checked after each child. A child that changes no count needs no check, unless the counts
        # already decide, which the check after the first child finds.
        due = passed >= needed or failures == too_many or failures > spare
        enough = 0 if due else needed
        remaining = iter(row)
        try:
            for tick in remaining:
                status = tick()
                if status is SUCCESS:
                    passed += 1
                    if passed < enough:
                        continue
                elif status is FAILURE:
                    failures += 1
                    self._failed = len(row) - length_hint(remaining) - 1
                elif status is SKIPPED:
                    skipped += 1
                    passed += tolerant
                elif not due:
                    # RUNNING, or completed before.
                    continue
                if passed >= needed:
                    result = SUCCESS
                    break
                if failures == too_many or failures > spare:
                    result = FAILURE
                    break
                due = False
                enough = needed
            else:
                result = SKIPPED if skipped == len(row) else RUNNING
        except BaseException:
            # The results of the others still count.
            self._keep(passed - skipped if tolerant else passed, failures)
            raise
        if result is SUCCESS or result is FAILURE:
            self._counted = failures
            self._successes = self._failures = 0
            return self._finish(result)
        if skipped and tolerant:
            passed -= skipped
        if passed != before or failures != self._failures:
            self._keep(passed, failures)
        return result

    def _keep(self, successes: int, failures: int) -> None:
        self._successes = successes
        self._failures = failures
        self._strike_out()

    def _read_limits(self) -> tuple[int, ...]:
        tolerant: bool = self.get_input('success_count') < 0
        return self._limit('success_count', 'succeed'), self._limit('failure_count', 'fail'), tolerant

    def halt(self) -> None:
        self._successes = self._failures = 0
        super().halt()


class ParallelAll(_ParallelControl):
    """Ticks all children until each has completed; FAILURE if ``max_failures`` or more of them failed.

    Despite the name, the default 1 fails if one child fails, but only after the other children have completed. A
    negative number is relative to the number of children (-1: all have to fail). Skipped children count as completed,
    but are ticked again while others are RUNNING. SKIPPED if all children are skipped in one tick.
    """

    __slots__ = ()

    ports = {
        'max_failures': input_port(INT, default='1', description='failures that are too many; negative: from the end'),
    }
    example = Example(
        '<ParallelAll max_failures="1"><AlwaysFailure/><Sleep msec="50"/></ParallelAll>',
        ticks=(RUNNING, FAILURE),
    )

    def execute(self) -> NodeStatus:
        (too_many,) = self._limits or self._current_limits()
        if self.stored_status is not RUNNING:
            self.status = RUNNING
            self._failed = None
        row = self._row
        try:
            results = [tick() for tick in row]
        except BaseException:
            self._strike_out()
            raise
        completed = results.count(SUCCESS)
        failures = 0
        if completed != len(results):
            if FAILURE in results:
                self._failed = len(results) - 1 - results[::-1].index(FAILURE)
                completed += results.count(FAILURE)
            if RUNNING in results:
                if completed:
                    self._strike_out()
                return RUNNING
            if results.count(SKIPPED) == len(results):
                return SKIPPED
            failures = sum(child.stored_status is FAILURE for child in self.children)
        self._counted = failures
        return self._finish(FAILURE if failures >= too_many else SUCCESS)

    def _read_limits(self) -> tuple[int, ...]:
        return (self._limit('max_failures', 'fail'),)


NODES: Final = (
    Parallel,
    ParallelAll,
)
