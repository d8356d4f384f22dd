# SPDX-License-Identifier: BSD-3-Clause
"""IfThenElse and WhileDoElse: a condition decides which of two branches is ticked.

The first child is the condition, the second the branch for SUCCESS, the third (which may be absent) that for FAILURE.
As in BehaviorTree.CPP the number of children is looked at when the node is ticked, so that a tree whose wrong node is
never reached runs; and a condition that is skipped is an error, since it says neither.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

from flexbt_core.behavior_tree.engine import ControlNode, NodeConfig, TreeNode, halt_child
from flexbt_core.behavior_tree.model import (
    FAILURE,
    IDLE,
    RUNNING,
    SKIPPED,
    SUCCESS,
    Choice,
    Example,
    NodeExecutionError,
    NodeStatus,
)


class _Conditional(ControlNode):
    __slots__ = ('_has_else', '_incomplete')

    tickable_with = (2, 3)

    def attach(self, children: Sequence[TreeNode]) -> None:
        super().attach(children)
        self._incomplete = self.incompleteness(len(children))
        self._has_else = len(children) == 3

    def _undecided(self) -> NodeExecutionError:
        return self.fault(f'the condition [{self.children[0].path}] was skipped, and so says neither yes nor no')


class IfThenElse(_Conditional):
    """Asks the condition once, then ticks the branch that it chose until that completes; its result is the node's.

    FAILURE when the condition fails and there is no third child. In that case alone the children are not set to IDLE,
    as in BehaviorTree.CPP: a condition that is a stateful action keeps its FAILURE, and is not asked anew, until the
    parent of the node resets or halts it. A third child avoids that, be it AlwaysFailure.
    """

    __slots__ = ('_chosen',)

    outcomes = Choice()
    example = Example(
        """
        <IfThenElse>
          <ScriptCondition code="battery > 20"/>
          <Script code="next := 'work'"/>
          <Script code="next := 'dock'"/>
        </IfThenElse>
        """,
        ticks=(SUCCESS,),
        before={'battery': 10},
        after={'next': 'dock'},
    )

    def __init__(self, config: NodeConfig) -> None:
        super().__init__(config)
        self._chosen = 0

    def execute(self) -> NodeStatus:
        if self._incomplete:
            raise self.fault(self._incomplete)
        self.status = RUNNING
        ticks = self._ticks
        chosen = self._chosen
        if not chosen:
            status = ticks[0]()
            if status is SUCCESS:
                chosen = 1
            elif status is FAILURE:
                if not self._has_else:
                    self._failed = 0
                    self.status = FAILURE
                    return FAILURE
                chosen = 2
            elif status is RUNNING:
                return RUNNING
            else:
                raise self._undecided()
            self._chosen = chosen
        status = ticks[chosen]()
        if status is RUNNING:
            return RUNNING
        self._chosen = 0
        # As reset_children does; a call would be much of the time that this takes.
        for child in self.children:
            if child.status is RUNNING:
                child.halt_node()
            child.status = IDLE
        if status is not SKIPPED:
            self._failed = chosen
            self.status = status
        return status

    def halt(self) -> None:
        self._chosen = 0
        super().halt()


class WhileDoElse(_Conditional):
    """Asks the condition at every tick, and ticks the branch that it chooses, halting the other one.

    The result of the branch is the node's. While the condition itself is RUNNING, the branches are left alone. FAILURE
    when the condition fails and there is no third child.
    """

    __slots__ = ()

    outcomes = Choice()
    example = Example(
        """
        <WhileDoElse>
          <ScriptCondition code="(asked += 1) == 1"/>
          <Sleep msec="100"/>
          <Script code="next := 'else'"/>
        </WhileDoElse>
        """,
        ticks=(RUNNING, SUCCESS),
        before={'asked': 0},
        after={'next': 'else'},
    )

    def execute(self) -> NodeStatus:
        if self._incomplete:
            raise self.fault(self._incomplete)
        self.status = RUNNING
        ticks = self._ticks
        status = ticks[0]()
        if status is SUCCESS:
            if self._has_else:
                halt_child(self.children[2])
            chosen = 1
            status = ticks[1]()
        elif status is FAILURE:
            chosen = 0
            if self._has_else:
                halt_child(self.children[1])
                chosen = 2
                status = ticks[2]()
        elif status is RUNNING:
            return RUNNING
        else:
            self.reset_children()
            raise self._undecided()
        if status is RUNNING:
            return RUNNING
        # As reset_children does; a call would be much of the time that this takes.
        for child in self.children:
            if child.status is RUNNING:
                child.halt_node()
            child.status = IDLE
        if status is not SKIPPED:
            self._failed = chosen
            self.status = status
        return status


NODES: Final = (IfThenElse, WhileDoElse)
