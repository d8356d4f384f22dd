# SPDX-License-Identifier: BSD-3-Clause
"""Parallel: ticks all children, and ends at a threshold of successes or failures."""

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
        self.status = RUNNING
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
