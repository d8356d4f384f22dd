# SPDX-License-Identifier: BSD-3-Clause
"""The control nodes of Nav2 that its stock trees use."""

from __future__ import annotations

from dataclasses import replace
from typing import Final

from flexbt_core.behavior_tree.engine import Control, NodeConfig, TreeNode
from flexbt_core.behavior_tree.model import (
    BOOL,
    FAILURE,
    INT,
    RUNNING,
    SKIPPED,
    SUCCESS,
    Example,
    NodeStatus,
    Recovered,
    TickAbandoned,
    input_port,
)


class RecoveryNode(Control):
    """Runs the first child; when it fails, the second, the recovery, and then the first again.

    At most ``number_of_retries`` recoveries are made, so one attempt more. FAILURE when they are used up, or when the
    recovery itself fails or is skipped; a skipped first child skips the node. Attempt and recovery follow each other
    within one tick.
    """

    __slots__ = ('_current', '_recoveries')

    ports = {'number_of_retries': input_port(INT, default='1', description='recoveries that are allowed')}
    children_bounds = (2, 2)
    outcomes = Recovered('number_of_retries')
    example = Example(
        """
        <RecoveryNode number_of_retries="2"><ScriptCondition code="(tries += 1) == 2"/><AlwaysSuccess/></RecoveryNode>
        """,
        ticks=(SUCCESS,),
        before={'tries': 0},
        after={'tries': 2},
    )

    def __init__(self, config: NodeConfig) -> None:
        super().__init__(config)
        self._current = 0
        self._recoveries = 0

    def tick(self) -> NodeStatus:
        allowed: int = self.get_input('number_of_retries')
        self.status = RUNNING
        while self._recoveries <= allowed:
            if self.context.stopping:
                raise TickAbandoned(self.path, self.id, 'the tree is being stopped', self.uid)
            status = self.tick_child(self._current)
            if status is RUNNING:
                return RUNNING
            if self._current == 0:
                if status is not FAILURE or self._recoveries >= allowed:
                    return self._finish(status)
                self.halt_child(0)
                self._current = 1
            elif status is SUCCESS:
                self.halt_child(1)
                self._recoveries += 1
                self._current = 0
            elif status is SKIPPED:
                self._current = 0
                return FAILURE
            else:
                return self._finish(FAILURE)
        return self._finish(FAILURE)

    def _finish(self, status: NodeStatus) -> NodeStatus:
        self._restart()
        self.reset_children()
        return status

    def halt(self) -> None:
        self._restart()
        super().halt()

    def _restart(self) -> None:
        self._current = self._recoveries = 0

    def failure_cause(self) -> TreeNode | None:
        # What could not be recovered says more than the recovery that could not help.
        return None if self._failed is None else self.children[0]

    def failure_reason(self) -> str:
        limit = f'(number_of_retries="{self.port_text("number_of_retries")}")'
        if self._failed is None:
            return f'{self.id}: no attempt is allowed {limit}'
        return f'{self.id}: {"no recovery was left" if self._failed == 0 else "the recovery failed"} {limit}'


class PipelineSequence(Control):
    """Ticks its children in order, every time from the first; those before the one that is reached are kept going.

    A RUNNING child lets the next be ticked only when that was reached before. SUCCESS as soon as the last child
    succeeds, FAILURE as soon as one fails. Children that have completed are ticked again, without a reset.
    """

    __slots__ = ('_reached',)

    runs_several = True
    example = Example(
        '<PipelineSequence><Script code="planned += 1"/><Sleep msec="100"/></PipelineSequence>',
        ticks=(RUNNING, SUCCESS),
        before={'planned': 0},
        after={'planned': 2},
    )

    def __init__(self, config: NodeConfig) -> None:
        super().__init__(config)
        self._reached = 0

    def tick(self) -> NodeStatus:
        skipped = 0
        for index in range(len(self.children)):
            status = self.tick_child(index)
            if status is FAILURE:
                return self._finish(FAILURE)
            if status is SKIPPED:
                skipped += 1
            elif status is RUNNING and index >= self._reached:
                self._reached = index
                return RUNNING
        return self._finish(SKIPPED if skipped == len(self.children) else SUCCESS)

    def _finish(self, status: NodeStatus) -> NodeStatus:
        self._reached = 0
        self.reset_children()
        return status

    def halt(self) -> None:
        self._reached = 0
        super().halt()


class RoundRobin(Control):
    """Tries one child after the other, in a circle, until one succeeds; begins the next time after that one.

    FAILURE when each child has failed (or was skipped) since the last success, over as many ticks as that takes. A
    success keeps the position, a failure of all and a halt forget it.

    Without ``wrap_around`` the last child ends it: FAILURE then, whatever that child gave, even SUCCESS.
    """

    __slots__ = ('_current', '_failures')

    nav2_branch = 'jazzy'
    tries_all = True

    ports = {
        'wrap_around': input_port(
            BOOL,
            default='true',
            description='whether the first child follows the last; by default so in jazzy, not in main',
            nav2_branch='main',
        )
    }
    example = Example(
        """
        <RoundRobin><AlwaysFailure/><Script code="chosen := 'second'"/></RoundRobin>
        """,
        ticks=(SUCCESS,),
        after={'chosen': 'second'},
    )

    def __init__(self, config: NodeConfig) -> None:
        super().__init__(config)
        self._current = 0
        self._failures = 0

    def tick(self) -> NodeStatus:
        total = len(self.children)
        self.status = RUNNING
        skipped = 0
        while self._failures + skipped < total:
            status = self.tick_child(self._current)
            if status is RUNNING:
                return RUNNING
            self._current += 1
            if self._current == total:
                if not self.get_input('wrap_around'):
                    skipped += status is SKIPPED
                    if status is SUCCESS:
                        self._failed = None
                    break
                self._current = 0
            if status is SUCCESS:
                self._failures = 0
                self.reset_children()
                return SUCCESS
            if status is FAILURE:
                self._failures += 1
            else:
                skipped += 1
        self._restart()
        self.reset_children()
        return SKIPPED if skipped == total else FAILURE

    def halt(self) -> None:
        self._restart()
        super().halt()

    def _restart(self) -> None:
        self._current = self._failures = 0

    def failure_reason(self) -> str:
        if self._failed is None:
            return f'{self.id}: the last child has had its turn, and wrap_around is false'
        return super().failure_reason()


class RoundRobinOfMain(RoundRobin):
    """RoundRobin as in the branch main of Nav2, where ``wrap_around`` is false unless it is given."""

    __slots__ = ()

    xml_name = 'RoundRobin'
    nav2_branch = 'main'
    ports = {'wrap_around': replace(RoundRobin.ports['wrap_around'], default='false')}


NODES: Final = (PipelineSequence, RecoveryNode, RoundRobin, RoundRobinOfMain)
