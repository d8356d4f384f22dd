# SPDX-License-Identifier: BSD-3-Clause
"""Parallel and ParallelAll: all children are ticked, and a number of successes or failures decides."""

from __future__ import annotations

from .node import ControlNode, NodeConfig
from .port_types import INT
from .ports import input_port
from .status import FAILURE, RUNNING, SKIPPED, SUCCESS, NodeStatus


class Parallel(ControlNode):
    """SUCCESS after ``success_count`` successes; FAILURE after ``failure_count`` failures, or once it is out of reach.

    Negative counts are counted from the number of children (-1: all); then skipped children count as successes too. The
    thresholds are looked at after every child, so that later ones may not be ticked at all. A child that has completed
    is not ticked again until the node is done; a skipped one is.
    """

    __slots__ = ('_completed', '_failures', '_successes')

    ports = {
        'success_count': input_port(INT, default='-1', description='successes needed; negative: from the end'),
        'failure_count': input_port(INT, default='1', description='failures that end it; negative: from the end'),
    }

    def __init__(self, config: NodeConfig) -> None:
        super().__init__(config)
        self._completed: set[int] = set()
        self._successes = 0
        self._failures = 0

    def execute(self) -> NodeStatus:
        total = len(self.children)
        success_count: int = self.get_input('success_count')
        failure_count: int = self.get_input('failure_count')
        success_needed = success_count if success_count >= 0 else max(total + success_count + 1, 0)
        failures_allowed = failure_count if failure_count >= 0 else max(total + failure_count + 1, 0)
        if total < success_needed:
            raise self.fault(f'success_count {success_count} is more than its {total} children: it can never succeed')
        if total < failures_allowed:
            raise self.fault(f'failure_count {failure_count} is more than its {total} children: it can never fail')
        if self.status is not RUNNING:
            self.status = RUNNING
            self._failed = None
        completed = self._completed
        skipped = 0
        for index, tick in enumerate(self._ticks):
            if index not in completed:
                status = tick()
                if status is SUCCESS:
                    completed.add(index)
                    self._successes += 1
                elif status is FAILURE:
                    completed.add(index)
                    self._failures += 1
                    self._failed = index
                elif status is SKIPPED:
                    skipped += 1
            passed = self._successes + skipped if success_count < 0 else self._successes
            if passed >= success_needed:
                return self._finish(SUCCESS)
            if total - self._failures < success_needed or self._failures == failures_allowed:
                return self._finish(FAILURE)
        return SKIPPED if skipped == total else RUNNING

    def _finish(self, status: NodeStatus) -> NodeStatus:
        self._clear()
        self.reset_children()
        self.status = status
        return status

    def _clear(self) -> None:
        self._completed.clear()
        self._successes = self._failures = 0

    def halt(self) -> None:
        self._clear()
        super().halt()

    def failure_reason(self) -> str:
        return f'{self.id}: no failure is one too many (failure_count="{self.port_text("failure_count")}")'


class ParallelAll(ControlNode):
    """Ticks all children until each has completed; FAILURE when ``max_failures`` of them or more have failed.

    So the default 1 fails at the first failure, in spite of its name, but not before the other children have completed.
    A negative number is counted from the number of children (-1: all have to fail). Skipped children count as
    completed, but are ticked again as long as others are RUNNING; SKIPPED when all are, within one tick.
    """

    __slots__ = ('_completed', '_failures')

    ports = {
        'max_failures': input_port(INT, default='1', description='failures that are too many; negative: from the end'),
    }

    def __init__(self, config: NodeConfig) -> None:
        super().__init__(config)
        self._completed: set[int] = set()
        self._failures = 0

    def execute(self) -> NodeStatus:
        total = len(self._ticks)
        max_failures: int = self.get_input('max_failures')
        too_many = max_failures if max_failures >= 0 else max(total + max_failures + 1, 0)
        if total < too_many:
            raise self.fault(f'max_failures {max_failures} is more than its {total} children: it can never fail')
        if self.status is not RUNNING:
            self.status = RUNNING
            self._failed = None
        completed = self._completed
        skipped = 0
        for index, tick in enumerate(self._ticks):
            if index not in completed:
                status = tick()
                if status is SUCCESS:
                    completed.add(index)
                elif status is FAILURE:
                    completed.add(index)
                    self._failures += 1
                    self._failed = index
                elif status is SKIPPED:
                    skipped += 1
        if skipped == total:
            return SKIPPED
        if skipped + len(completed) < total:
            return RUNNING
        self.reset_children()
        status = FAILURE if self._failures >= too_many else SUCCESS
        self._clear()
        self.status = status
        return status

    def _clear(self) -> None:
        self._completed.clear()
        self._failures = 0

    def halt(self) -> None:
        self._clear()
        super().halt()

    def failure_reason(self) -> str:
        return f'{self.id}: no failure is one too many (max_failures="{self.port_text("max_failures")}")'
