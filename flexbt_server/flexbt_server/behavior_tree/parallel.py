# SPDX-License-Identifier: BSD-3-Clause
"""Parallel and ParallelAll: all children are ticked, and a number of successes or failures decides."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Sequence

from .node import ControlNode, Execute, NodeConfig, TreeNode
from .port_types import INT
from .ports import input_port
from .status import FAILURE, IDLE, RUNNING, SKIPPED, SUCCESS, NodeStatus


def _completed() -> NodeStatus:
    """Takes the place of the tick of a child that has completed."""
    return IDLE


class _ParallelControl(ControlNode):
    """A child that has completed is not ticked again until the node is done.

    Thresholds are ports, and may change from tick to tick; those that cannot, because they are literals, are kept.
    """

    __slots__ = ('_failures', '_limits', '_row')

    def __init__(self, config: NodeConfig) -> None:
        super().__init__(config)
        self._failures = 0
        self._limits: tuple[int, ...] | None = None

    def attach(self, children: Sequence[TreeNode]) -> None:
        super().attach(children)
        self._row: list[Execute] = list(self._ticks)

    @abstractmethod
    def _read_limits(self) -> tuple[int, ...]:
        """The thresholds, by the ports."""

    def _current_limits(self) -> tuple[int, ...]:
        limits = self._read_limits()
        if all(self.port_key(port) is None for port in self.ports):
            self._limits = limits
        return limits

    def _limit(self, port: str, what: str) -> int:
        """A threshold, counted from no child on."""
        total = len(self.children)
        count: int = self.get_input(port)
        limit = count if count >= 0 else max(total + count + 1, 0)
        if limit > total:
            raise self.fault(f'{port} {count} is more than its {total} children: it can never {what}')
        return limit

    def _finish(self, status: NodeStatus) -> NodeStatus:
        self._forget()
        for child in self.children:
            if child.status is RUNNING:
                child.halt()
            child.status = IDLE
        self.status = status
        return status

    def _forget(self) -> None:
        self._row[:] = self._ticks
        self._failures = 0

    def halt(self) -> None:
        self._forget()
        super().halt()


class Parallel(_ParallelControl):
    """SUCCESS after ``success_count`` successes; FAILURE after ``failure_count`` failures, or once it is out of reach.

    Negative counts are counted from the number of children (-1: all); then skipped children count as successes too. The
    thresholds are looked at after every child, so that later ones may not be ticked at all. A child that has completed
    is not ticked again until the node is done; a skipped one is.
    """

    __slots__ = ('_successes',)

    ports = {
        'success_count': input_port(INT, default='-1', description='successes needed; negative: from the end'),
        'failure_count': input_port(INT, default='1', description='failures that end it; negative: from the end'),
    }

    def __init__(self, config: NodeConfig) -> None:
        super().__init__(config)
        self._successes = 0

    def execute(self) -> NodeStatus:
        needed, too_many, tolerant = self._limits or self._current_limits()
        if self.status is not RUNNING:
            self.status = RUNNING
            self._failed = None
        row = self._row
        passed = self._successes
        failures = self._failures
        spare = len(row) - needed
        skipped = 0
        try:
            for index, tick in enumerate(row):
                status = tick()
                if status is SUCCESS:
                    passed += 1
                    row[index] = _completed
                elif status is FAILURE:
                    failures += 1
                    row[index] = _completed
                    self._failed = index
                elif status is SKIPPED:
                    skipped += 1
                    passed += tolerant
                elif index:
                    # RUNNING, or completed before: what was found after the child before it still holds.
                    continue
                if passed >= needed:
                    return self._finish(SUCCESS)
                if status is SUCCESS and index:
                    continue
                if failures == too_many or failures > spare:
                    return self._finish(FAILURE)
        finally:
            # Not when it is done: then it begins anew. But when a child raises, for what others have given counts.
            if self.status is RUNNING:
                self._successes = passed - skipped if tolerant else passed
                self._failures = failures
        return SKIPPED if skipped == len(row) else RUNNING

    def _read_limits(self) -> tuple[int, ...]:
        tolerant: bool = self.get_input('success_count') < 0
        return self._limit('success_count', 'succeed'), self._limit('failure_count', 'fail'), tolerant

    def _forget(self) -> None:
        self._row[:] = self._ticks
        self._failures = self._successes = 0

    def failure_reason(self) -> str:
        return f'{self.id}: no failure is one too many (failure_count="{self.port_text("failure_count")}")'


class ParallelAll(_ParallelControl):
    """Ticks all children until each has completed; FAILURE when ``max_failures`` of them or more have failed.

    So the default 1 fails at the first failure, in spite of its name, but not before the other children have completed.
    A negative number is counted from the number of children (-1: all have to fail). Skipped children count as
    completed, but are ticked again as long as others are RUNNING; SKIPPED when all are, within one tick.
    """

    __slots__ = ()

    ports = {
        'max_failures': input_port(INT, default='1', description='failures that are too many; negative: from the end'),
    }

    def execute(self) -> NodeStatus:
        (too_many,) = self._limits or self._current_limits()
        if self.status is not RUNNING:
            self.status = RUNNING
            self._failed = None
        row = self._row
        running = skipped = 0
        for index, tick in enumerate(row):
            status = tick()
            if status is SUCCESS:
                row[index] = _completed
            elif status is FAILURE:
                row[index] = _completed
                self._failures += 1
                self._failed = index
            elif status is RUNNING:
                running += 1
            elif status is SKIPPED:
                skipped += 1
        if running:
            return RUNNING
        if skipped == len(row):
            return SKIPPED
        return self._finish(FAILURE if self._failures >= too_many else SUCCESS)

    def _read_limits(self) -> tuple[int, ...]:
        return (self._limit('max_failures', 'fail'),)

    def failure_reason(self) -> str:
        return f'{self.id}: no failure is one too many (max_failures="{self.port_text("max_failures")}")'
