# SPDX-License-Identifier: BSD-3-Clause
"""Control nodes of Nav2: recovery, pipeline, round robin, sequences of its branch main, pause and resume."""

from __future__ import annotations

import threading
from dataclasses import replace
from enum import Enum
from typing import Final

from flexbt_core.behavior_tree.engine.node import NodeConfig, TreeNode
from flexbt_core.behavior_tree.engine.parents import Control
from flexbt_core.behavior_tree.model.errors import TickAbandoned
from flexbt_core.behavior_tree.model.outcomes import Example, Recovered
from flexbt_core.behavior_tree.model.ports import BOOL, INT, STRING, inout_port, input_port
from flexbt_core.behavior_tree.model.status import FAILURE, IDLE, RUNNING, SKIPPED, SUCCESS, NodeStatus


class RecoveryNode(Control):
    """Runs the first child; if it fails, runs the second, the recovery, and then the first again.

    Runs at most ``number_of_retries`` recoveries, and so one attempt more. FAILURE if none is left, or if the recovery
    itself fails or is skipped. A skipped first child skips the node. An attempt and a recovery follow each other within
    one tick.
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
        if self.stored_status is not RUNNING:
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
                self.halt_child(1)
                self._current = 0
                return FAILURE
            else:
                return self._finish(FAILURE)
        return self._finish(FAILURE)

    def _finish(self, status: NodeStatus) -> NodeStatus:
        self._restart()
        self.reset_children()
        if status is SKIPPED:
            self.status = IDLE
        return status

    def halt(self) -> None:
        self._restart()
        super().halt()

    def _restart(self) -> None:
        self._current = self._recoveries = 0

    def failure_cause(self) -> TreeNode | None:
        # The failure of the first child explains more than that of the recovery.
        return None if self._failed is None else self.children[0]

    def failure_reason(self) -> str:
        limit = f'(number_of_retries="{self.port_text("number_of_retries")}")'
        if self._failed is None:
            return f'{self.id}: no attempt is allowed {limit}'
        return f'{self.id}: {"no recovery was left" if self._failed == 0 else "the recovery failed"} {limit}'


class PipelineSequence(Control):
    """Ticks its children in order, at every tick from the first up to the furthest one reached.

    If a child is RUNNING, the next is ticked only if it was reached before. SUCCESS as soon as the last child succeeds,
    FAILURE as soon as one fails. The node ticks completed children again, without a reset.
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
    """Tries its children in turn until one succeeds; the next run starts after that child.

    FAILURE when each child has failed or been skipped since the last success, over any number of ticks. A success keeps
    the position; a failure of all children and a halt reset it.

    Without ``wrap_around``, the node fails after the last child, even if that child returned SUCCESS.
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
        if self.stored_status is not RUNNING:
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
        if skipped < total:
            return FAILURE
        self.status = IDLE
        return SKIPPED

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
    """RoundRobin as in the branch main of Nav2, where ``wrap_around`` defaults to false."""

    __slots__ = ()

    xml_name = 'RoundRobin'
    nav2_branch = 'main'
    ports = {'wrap_around': replace(RoundRobin.ports['wrap_around'], default='false')}


# The sequences that Nav2 has in its branch main: NonblockingSequence and PersistentSequence.


class NonblockingSequence(Control):
    """Ticks all its children at every tick. SUCCESS when all succeed in one tick; FAILURE as soon as one fails.

    While others are RUNNING, the node ticks children that have succeeded again, without a reset. A skipped child is an
    error.
    """

    __slots__ = ()

    nav2_branch = 'main'
    runs_several = True
    example = Example(
        '<NonblockingSequence><Sleep msec="100"/><Script code="n += 1"/></NonblockingSequence>',
        ticks=(RUNNING, SUCCESS),
        before={'n': 0},
        after={'n': 2},
    )

    def tick(self) -> NodeStatus:
        result = SUCCESS
        for index in range(len(self.children)):
            status = self.tick_child(index)
            if status is FAILURE:
                self.reset_children()
                return FAILURE
            if status is SKIPPED:
                raise self.fault(f'the child [{self.children[index].path}] was skipped; {self.id} has no rule for that')
            if status is RUNNING:
                result = RUNNING
        if result is SUCCESS:
            self.reset_children()
        return result


class PersistentSequence(Control):
    """A Sequence that keeps its position on the blackboard, and continues from there after a halt or in another run.

    SUCCESS and SKIPPED of a child advance ``current_child_idx``; the end and a FAILURE set it to 0. The entry must
    exist before the first tick: create it with ``<Script code="current_child_idx := 0"/>``, for example.
    """

    __slots__ = ()

    nav2_branch = 'main'
    ports = {'current_child_idx': inout_port(INT, description='{key} of the position, from 0')}
    example = Example(
        """
        <PersistentSequence current_child_idx="{position}"><AlwaysSuccess/><Sleep msec="100"/></PersistentSequence>
        """,
        ticks=(RUNNING, SUCCESS),
        before={'position': 0},
        after={'position': 0},
    )

    def tick(self) -> NodeStatus:
        current: int = self.get_input('current_child_idx')
        if current < 0:
            raise ValueError(f'port [current_child_idx] has to be a position from 0 on, not {current}')
        if self.stored_status is not RUNNING:
            self.status = RUNNING
        while current < len(self.children):
            status = self.tick_child(current)
            if status is RUNNING:
                return RUNNING
            if status is FAILURE:
                return self._finish(FAILURE)
            current += 1
            self.set_output('current_child_idx', current)
        return self._finish(SUCCESS)

    def _finish(self, status: NodeStatus) -> NodeStatus:
        self.reset_children()
        self.set_output('current_child_idx', 0)
        return status


# PauseResumeController of Nav2 (branch main): a tree within a tree that can be paused from outside.


class PauseState(Enum):
    """The phase of a PauseResumeController. The value is the index of its child."""

    RESUMED = 0
    PAUSED = 1
    ON_PAUSE = 2
    ON_RESUME = 3


_NEXT: Final = {PauseState.ON_PAUSE: PauseState.PAUSED, PauseState.ON_RESUME: PauseState.RESUMED}


class PauseResumeController(Control):
    """Ticks its first child. On a pause it runs the third child, then the second; on a resume it runs the fourth, then
    the first again.

    A request halts the RUNNING child. The node returns the result of the first child (SUCCESS if skipped). When another
    child completes, the node goes to the next phase, or fails if that child failed. Only the first child is required.
    """

    # The host derives from this class, and calls pause and resume when the services named by the ports are called.

    __slots__ = ('_lock', '_requested', '_state')

    ports = {
        'pause_service_name': input_port(STRING, optional=True, description='service that pauses'),
        'resume_service_name': input_port(STRING, optional=True, description='service that resumes'),
    }
    children_bounds = (1, 4)

    def __init__(self, config: NodeConfig) -> None:
        super().__init__(config)
        self._lock = threading.Lock()
        self._state = PauseState.RESUMED
        self._requested: PauseState | None = None

    @property
    def state(self) -> PauseState:
        return self._state

    @property
    def awaits_request(self) -> bool:
        return self._state is PauseState.PAUSED

    def pause(self) -> bool:
        """Request a pause, from any thread. Return False if the node is already paused, or is not RUNNING."""
        with self._lock:
            if self.stored_status is not RUNNING or (self._state is PauseState.PAUSED and self._requested is None):
                return False
            self._requested = PauseState.ON_PAUSE
        self.wake()
        return True

    def resume(self) -> bool:
        """Request the end of a pause, from any thread. Return False if the node is not paused."""
        with self._lock:
            if self._state is not PauseState.PAUSED or self._requested is not None:
                return False
            self._requested = PauseState.ON_RESUME
        self.wake()
        return True

    def tick(self) -> NodeStatus:
        if not self.active:
            self._restart()
        if self.stored_status is not RUNNING:
            self.status = RUNNING
        with self._lock:
            requested, self._requested = self._requested, None
            if requested is not None:
                self._state = requested
        if requested is not None:
            self.reset_children()
        index = self._state.value
        if index < len(self.children):
            status = self.tick_child(index)
            if status is RUNNING:
                return RUNNING
            self.reset_children()
            if status is FAILURE:
                return FAILURE
            if self._state is PauseState.RESUMED:
                return SUCCESS
        following = _NEXT.get(self._state)
        if following is not None:
            self._state = following
            self.context.woken = True
        return RUNNING

    def halt(self) -> None:
        self._restart()
        super().halt()

    def _restart(self) -> None:
        with self._lock:
            self._state = PauseState.RESUMED
            self._requested = None


NODES: Final = (
    PipelineSequence,
    RecoveryNode,
    RoundRobin,
    RoundRobinOfMain,
    NonblockingSequence,
    PersistentSequence,
)
