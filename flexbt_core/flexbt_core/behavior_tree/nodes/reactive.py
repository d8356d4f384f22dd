# SPDX-License-Identifier: BSD-3-Clause
"""ReactiveSequence and ReactiveFallback: every tick begins with the first child.

While one child is RUNNING all others, before and after it, are halted and set to IDLE; a skipped child is set to IDLE.
"""

from __future__ import annotations

from operator import length_hint
from typing import Final

from flexbt_core.behavior_tree.engine import ControlNode, halt_child
from flexbt_core.behavior_tree.model import (
    FAILURE,
    RUNNING,
    SKIPPED,
    SUCCESS,
    Example,
    InOrder,
    NodeStatus,
)


class _ReactiveControl(ControlNode):
    __slots__ = ()

    _passing: NodeStatus

    def execute(self) -> NodeStatus:
        self.status = RUNNING
        passing = self._passing
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
    """SUCCESS when all children succeed within one tick; FAILURE as soon as one fails, halting the one that runs."""

    __slots__ = ()

    _passing = SUCCESS
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
    """SUCCESS as soon as a child succeeds, halting the one that runs; FAILURE when all fail within one tick."""

    __slots__ = ()

    tries_all = True
    _passing = FAILURE
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


NODES: Final = (ReactiveSequence, ReactiveFallback)
