# SPDX-License-Identifier: BSD-3-Clause
"""The nodes of Nav2 that need no ROS, and the registration of them all in one of the two dialects."""

from __future__ import annotations

from typing import ClassVar, Final, Literal, get_args

from flexbt_core.behavior_tree.engine import Condition, Decorator, NodeConfig, NodeRegistry, TreeNode
from flexbt_core.behavior_tree.model import (
    DOUBLE,
    FAILURE,
    INT,
    RUNNING,
    SUCCESS,
    UINT16,
    Example,
    NodeStatus,
    input_port,
    list_of,
)

from .controls import PipelineSequence, RecoveryNode, RoundRobin, RoundRobinOfMain
from .goals import GlobalUpdatedGoal, GoalUpdated, GoalUpdatedController
from .paths import PathLongerOnApproach
from .sequences import NonblockingSequence, PersistentSequence


class RateController(Decorator):
    """Begins the child ``hz`` times a second at most; RUNNING in between. A RUNNING child is ticked every time.

    The period counts from the last success of the child. Unlike Nav2's, which knows only the machine's clock, it goes
    by the clock of the tree, so simulated time speeds it up; it asks for a wake-up when the period is over.
    """

    __slots__ = ('_first', '_period', '_start')

    ports = {'hz': input_port(DOUBLE, default='10.0', description='rate in 1/s')}
    example = Example(
        '<RateController hz="2"><Script code="n += 1"/></RateController>',
        ticks=(SUCCESS,),
        before={'n': 0},
        after={'n': 1},
    )

    def __init__(self, config: NodeConfig) -> None:
        super().__init__(config)
        self._period = 0.0
        self._start = 0.0
        self._first = True

    def tick(self) -> NodeStatus:
        now = self.clock.now()
        if not self.active:
            hz: float = self.get_input('hz')
            if not hz > 0.0:
                raise ValueError(f'port [hz] has to be a positive rate, not {hz}')
            self._period = 1.0 / hz
            self._start = now
            self._first = True
        self.status = RUNNING
        # The comparison is the one of the wake-up time: a difference of times could round to less than the period.
        if not self._first and self.child.status is not RUNNING and now < self._start + self._period:
            self.wake_at(self._start + self._period)
            return RUNNING
        self._first = False
        status = self.tick_child()
        if status is SUCCESS:
            self._start = now
            self.wake_at(now + self._period)
        return status

    def on_halt(self) -> None:
        self.cancel_wake()


class SingleTrigger(Decorator):
    """Runs the child once; FAILURE from then on, until the node is set to IDLE."""

    __slots__ = ('_armed',)

    example = Example(
        """
        <KeepRunningUntilFailure>
          <Inverter><SingleTrigger><AlwaysFailure/></SingleTrigger></Inverter>
        </KeepRunningUntilFailure>
        """,
        ticks=(RUNNING, RUNNING),
    )

    def __init__(self, config: NodeConfig) -> None:
        super().__init__(config)
        self._armed = True

    def tick(self) -> NodeStatus:
        if not self.active:
            self._armed = True
        self.status = RUNNING
        if not self._armed:
            return FAILURE
        status = self.tick_child()
        if status is SUCCESS or status is FAILURE:
            self._armed = False
        return status

    def failure_reason(self) -> str:
        if self._child_failed:
            return super().failure_reason()
        return f'{self.id}: the child [{self.child.path}] had its one run before'


class AreErrorCodesPresent(Condition):
    """SUCCESS when ``error_code`` is one of ``error_codes_to_check``. A code that was never written counts as 0."""

    __slots__ = ()

    ports = {
        'error_code': input_port(UINT16, optional=True, description='code that an action has left'),
        'error_codes_to_check': input_port(list_of(INT), optional=True, description='codes, separated by ;'),
    }
    default_codes: ClassVar[tuple[int, ...]] = ()
    example = Example('<AreErrorCodesPresent error_code="106" error_codes_to_check="103;106"/>', ticks=(SUCCESS,))

    def tick(self) -> NodeStatus:
        code: int = self.get_input_or('error_code', 0)
        codes = self.get_input_or('error_codes_to_check', self.default_codes)
        return SUCCESS if code in codes else self.fail(f'error code {code} is none of {sorted(codes)}')


class WouldAControllerRecoveryHelp(AreErrorCodesPresent):
    """SUCCESS when FollowPath failed for a reason that a recovery may remove.

    UNKNOWN, PATIENCE_EXCEEDED, FAILED_TO_MAKE_PROGRESS, NO_VALID_CONTROL.
    """

    __slots__ = ()

    default_codes = (100, 104, 105, 106)
    example = Example('<WouldAControllerRecoveryHelp error_code="{follow_path_error_code}"/>')


class WouldAPlannerRecoveryHelp(AreErrorCodesPresent):
    """SUCCESS when a path planner failed for a reason that a recovery may remove: UNKNOWN, TIMEOUT, NO_VALID_PATH."""

    __slots__ = ()

    default_codes = (200, 207, 208, 300, 307, 308)
    example = Example('<WouldAPlannerRecoveryHelp error_code="{compute_path_error_code}"/>')


class WouldASmootherRecoveryHelp(AreErrorCodesPresent):
    """SUCCESS when SmoothPath failed for a reason that a recovery may remove.

    UNKNOWN, TIMEOUT, SMOOTHED_PATH_IN_COLLISION, FAILED_TO_SMOOTH_PATH.
    """

    __slots__ = ()

    default_codes = (500, 502, 503, 504)


class WouldARouteRecoveryHelp(AreErrorCodesPresent):
    """SUCCESS when no route was found for a reason that a recovery may remove: UNKNOWN, TIMEOUT, NO_VALID_ROUTE.

    Of the branch main of Nav2.
    """

    __slots__ = ()

    default_codes = (400, 404, 405)


Dialect = Literal['jazzy', 'main']
"""Branches of Nav2 whose nodes differ. Nodes that only ``main`` has are there in both dialects."""

DIALECTS: Final[tuple[Dialect, ...]] = get_args(Dialect)

_NODES: Final[tuple[type[TreeNode], ...]] = (
    PipelineSequence,
    RecoveryNode,
    NonblockingSequence,
    PersistentSequence,
    PathLongerOnApproach,
    RateController,
    SingleTrigger,
    GoalUpdatedController,
    GoalUpdated,
    GlobalUpdatedGoal,
    AreErrorCodesPresent,
    WouldAControllerRecoveryHelp,
    WouldAPlannerRecoveryHelp,
    WouldASmootherRecoveryHelp,
    WouldARouteRecoveryHelp,
)


def register(registry: NodeRegistry, dialect: Dialect = 'jazzy') -> None:
    """Registers all nodes of this module, under the names that Nav2 gives them."""
    for node_class in _NODES:
        registry.register(node_class.__name__, node_class)
    registry.register('RoundRobin', RoundRobin if dialect == 'jazzy' else RoundRobinOfMain)
