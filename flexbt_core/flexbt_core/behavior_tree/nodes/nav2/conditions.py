# SPDX-License-Identifier: BSD-3-Clause
"""Conditions of Nav2 that need no ROS, on changed goals, elapsed time and error codes, with GoalUpdatedController."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, ClassVar, Final

from flexbt_core.behavior_tree.engine.leaf import Condition
from flexbt_core.behavior_tree.engine.node import NodeConfig, TreeNode
from flexbt_core.behavior_tree.engine.parents import Decorator
from flexbt_core.behavior_tree.model.outcomes import Example
from flexbt_core.behavior_tree.model.ports import BOOL, DOUBLE, INT, UINT16, Port, cast, input_port, list_of
from flexbt_core.behavior_tree.model.status import FAILURE, IDLE, RUNNING, SUCCESS, NodeStatus

GOAL_PORTS: Final[Mapping[str, Port]] = {
    'goal': input_port(optional=True, description='goal pose; by default the entry [goal]'),
    'goals': input_port(optional=True, description='poses to pass; by default the entry [goals]'),
}


def read_goals(node: TreeNode, latched: tuple[Any, Any]) -> tuple[Any, Any]:
    """Return goal and goals: from the ports, else the entries of these names, else the ``latched`` values."""
    return _read(node, 'goal', latched[0]), _read(node, 'goals', latched[1])


def _read(node: TreeNode, port: str, latched: Any) -> Any:
    if node.port_text(port) is None:
        return node.blackboard.get_or(port, latched)
    return node.get_input_or(port, latched)


class GoalUpdated(Condition):
    """SUCCESS, once, when the goal differs from that of the previous tick.

    The first tick after IDLE only remembers the goal. So the node never succeeds directly below a reactive node with a
    RUNNING child, which sets it to IDLE in every tick. Nav2's recovery branch is such a case.
    """

    __slots__ = ('_latched',)

    ports = GOAL_PORTS
    example = Example('<GoalUpdated/>')

    def __init__(self, config: NodeConfig) -> None:
        super().__init__(config)
        self._latched: tuple[Any, Any] = (None, None)

    def tick(self) -> NodeStatus:
        current = read_goals(self, self._latched)
        changed = self.stored_status is not IDLE and current != self._latched
        self._latched = current
        return SUCCESS if changed else FAILURE


class GlobalUpdatedGoal(Condition):
    """SUCCESS in the first tick of the tree's life, and whenever the goal differs from that of the previous tick."""

    __slots__ = ('_first', '_latched')

    ports = GOAL_PORTS
    example = Example('<GlobalUpdatedGoal/>')

    def __init__(self, config: NodeConfig) -> None:
        super().__init__(config)
        self._first = True
        self._latched: tuple[Any, Any] = (None, None)

    def tick(self) -> NodeStatus:
        current = read_goals(self, self._latched)
        changed = self._first or current != self._latched
        self._first = False
        self._latched = current
        return SUCCESS if changed else FAILURE


class GoalUpdatedController(Decorator):
    """Ticks the child in the first tick, when the goal changes, and while it is RUNNING; RUNNING otherwise."""

    __slots__ = ('_latched', '_updated')

    ports = GOAL_PORTS
    example = Example('<GoalUpdatedController><AlwaysSuccess/></GoalUpdatedController>')

    def __init__(self, config: NodeConfig) -> None:
        super().__init__(config)
        self._latched: tuple[Any, Any] = (None, None)
        self._updated = False

    def tick(self) -> NodeStatus:
        current = read_goals(self, self._latched)
        if not self.active or current != self._latched:
            self._updated = True
        self._latched = current
        if self.stored_status is not RUNNING:
            self.status = RUNNING
        if self._updated or self.child.stored_status is RUNNING:
            self._updated = False
            return self.tick_child()
        return RUNNING


# Conditions of Nav2 on elapsed time, by the clock of the tree, and on a received initial pose.

_SECONDS: Final = input_port(DOUBLE, default='1.0', description='s')


class TimeExpired(Condition):
    """SUCCESS whenever ``seconds`` have passed; the first tick after IDLE only starts the timer.

    A parent that sets it to IDLE, such as a ReactiveSequence with a RUNNING child, restarts the timer in each tick. The
    node requests a wake-up at the end of the time.
    """

    __slots__ = ('_start',)

    ports = {'seconds': _SECONDS}
    example = Example(
        '<Fallback><TimeExpired seconds="2"/><AlwaysSuccess/></Fallback>',
    )

    def __init__(self, config: NodeConfig) -> None:
        super().__init__(config)
        self._start = 0.0

    def tick(self) -> NodeStatus:
        now = self.clock.now()
        seconds: float = self.get_input('seconds')
        begins = self.stored_status is IDLE
        # Compare with the wake-up time: a difference of times could round to less than the period.
        expired = not begins and now >= self._start + seconds
        if begins or expired:
            self._start = now
        self.wake_at(self._start + seconds)
        return SUCCESS if expired else FAILURE


class PathExpiringTimer(Condition):
    """SUCCESS each time that the path on the blackboard has not changed for another ``seconds``.

    The first tick of the tree's life only starts the timer. The node requests a wake-up at the end of the time.
    """

    __slots__ = ('_first', '_path', '_start')

    ports = {
        'seconds': _SECONDS,
        'path': input_port(optional=True, description='the path'),
    }
    example = Example('<PathExpiringTimer seconds="10" path="{path}"/>')

    def __init__(self, config: NodeConfig) -> None:
        super().__init__(config)
        self._first = True
        self._path: Any = None
        self._start = 0.0

    def tick(self) -> NodeStatus:
        path = self.get_input_or('path', None)
        now = self.clock.now()
        # The entry holds the same object until the next write: no need to compare hundreds of poses.
        if self._first or (path is not self._path and path != self._path):
            self._start = now
        self._path = path
        seconds: float = self.get_input('seconds')
        first, self._first = self._first, False
        expired = not first and now >= self._start + seconds
        if expired:
            self._start = now
        self.wake_at(self._start + seconds)
        return SUCCESS if expired else FAILURE


class InitialPoseReceived(Condition):
    """SUCCESS if the entry reports that the initial pose of the robot was received."""

    __slots__ = ()

    ports = {
        'initial_pose_received': input_port(
            BOOL, optional=True, description='whether it was; by default the entry [initial_pose_received]'
        )
    }
    example = Example('<InitialPoseReceived/>', ticks=(SUCCESS,), before={'initial_pose_received': True})

    def tick(self) -> NodeStatus:
        if self.port_text('initial_pose_received') is None:
            received = cast(self.blackboard.get_or('initial_pose_received', False), BOOL)
        else:
            received = self.get_input_or('initial_pose_received', False)
        return SUCCESS if received else self.fail('no first pose of the robot was received')


# Conditions of Nav2 on the error code of an action.


class AreErrorCodesPresent(Condition):
    """SUCCESS when ``error_code`` is one of ``error_codes_to_check``. A code that was never written counts as 0."""

    __slots__ = ()

    ports = {
        'error_code': input_port(UINT16, optional=True, description='error code of an action'),
        'error_codes_to_check': input_port(list_of(INT), optional=True, description='codes, separated by ;'),
    }
    default_codes: ClassVar[tuple[int, ...]] = ()
    example = Example('<AreErrorCodesPresent error_code="106" error_codes_to_check="103;106"/>', ticks=(SUCCESS,))

    def tick(self) -> NodeStatus:
        code: int = self.get_input_or('error_code', 0)
        codes = self.get_input_or('error_codes_to_check', self.default_codes)
        return SUCCESS if code in codes else self.fail(f'error code {code} is none of {sorted(codes)}')


class WouldAControllerRecoveryHelp(AreErrorCodesPresent):
    """SUCCESS when FollowPath failed for a reason that a recovery may resolve.

    UNKNOWN, PATIENCE_EXCEEDED, FAILED_TO_MAKE_PROGRESS, NO_VALID_CONTROL.
    """

    __slots__ = ()

    default_codes = (100, 104, 105, 106)
    example = Example('<WouldAControllerRecoveryHelp error_code="{follow_path_error_code}"/>')


class WouldAPlannerRecoveryHelp(AreErrorCodesPresent):
    """SUCCESS when a path planner failed for a reason that a recovery may resolve: UNKNOWN, TIMEOUT, NO_VALID_PATH."""

    __slots__ = ()

    default_codes = (200, 207, 208, 300, 307, 308)
    example = Example('<WouldAPlannerRecoveryHelp error_code="{compute_path_error_code}"/>')


class WouldASmootherRecoveryHelp(AreErrorCodesPresent):
    """SUCCESS when SmoothPath failed for a reason that a recovery may resolve.

    UNKNOWN, TIMEOUT, SMOOTHED_PATH_IN_COLLISION, FAILED_TO_SMOOTH_PATH.
    """

    __slots__ = ()

    default_codes = (500, 502, 503, 504)
    example = Example('<WouldASmootherRecoveryHelp error_code="{smoother_error_code}"/>')


class WouldARouteRecoveryHelp(AreErrorCodesPresent):
    """SUCCESS when no route was found for a reason that a recovery may resolve: UNKNOWN, TIMEOUT, NO_VALID_ROUTE."""

    __slots__ = ()

    nav2_branch = 'main'
    default_codes = (400, 404, 405)
    example = Example('<WouldARouteRecoveryHelp error_code="{route_error_code}"/>')


NODES: Final = (
    GoalUpdatedController,
    GoalUpdated,
    GlobalUpdatedGoal,
    TimeExpired,
    PathExpiringTimer,
    InitialPoseReceived,
    AreErrorCodesPresent,
    WouldAControllerRecoveryHelp,
    WouldAPlannerRecoveryHelp,
    WouldASmootherRecoveryHelp,
    WouldARouteRecoveryHelp,
)
