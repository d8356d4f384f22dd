# SPDX-License-Identifier: BSD-3-Clause
"""The action leaves of Nav2's trees. Names, ports and defaults are those of Nav2 (Jazzy).

One difference is deliberate: the planners leave ``{path}`` alone when the tree ends. (Nav2 empties it in the sweep of
halts that ends every run; here a controller's tree may take the path from the blackboard after the planner's.)
"""

from __future__ import annotations

import math
from typing import Any, Final

from geometry_msgs.msg import Point, PoseStamped
from nav2_msgs import action
from nav_msgs.msg import Path

from flexbt_common import names
from flexbt_common.calls import GoalOutcome
from flexbt_common.values import duration_message
from flexbt_core.behavior_tree import NodeConfig, NodeStatus, input_port, output_port
from flexbt_core.behavior_tree.model import BOOL, DOUBLE, STRING
from flexbt_server.trees import PATH, POSE_STAMPED, POSES, RECOVERIES_KEY

from .action_leaf import ACTION_PORTS, ActionLeaf


class ComputePathToPose(ActionLeaf):
    """Plans a path to ``goal``, from the robot's pose or from ``start``."""

    __slots__ = ()

    action_type = action.ComputePathToPose
    default_server = names.COMPUTE_PATH_TO_POSE
    cancels_on_pause = False  # nothing moves by it
    ports = ACTION_PORTS | {
        'goal': input_port(POSE_STAMPED, description='where the path ends'),
        'start': input_port(POSE_STAMPED, optional=True, description="where it begins, instead of the robot's pose"),
        'use_start': input_port(BOOL, optional=True, description='whether start counts; true when it is given'),
        'planner_id': input_port(STRING, default='', description='planner to use'),
        'path': output_port(PATH, description='the path; empty when there is none'),
    }

    def make_goal(self) -> Any:
        start = self.get_input_or('start', None)
        return self.action_type.Goal(
            goal=self.get_input('goal'),
            start=start or PoseStamped(),
            use_start=bool(self.get_input_or('use_start', start is not None)),
            planner_id=str(self.get_input('planner_id')),
        )

    def on_success(self, result: Any) -> NodeStatus:
        self.set_output('path', result.path)
        return NodeStatus.SUCCESS

    def on_failure(self, outcome: GoalOutcome) -> None:
        self.set_output('path', Path())


class ComputePathThroughPoses(ActionLeaf):
    """Plans a path through ``goals``, in their order."""

    __slots__ = ()

    action_type = action.ComputePathThroughPoses
    default_server = names.COMPUTE_PATH_THROUGH_POSES
    cancels_on_pause = False  # nothing moves by it
    ports = ACTION_PORTS | {
        'goals': input_port(POSES, description='poses to pass; the last is where the path ends'),
        'start': input_port(POSE_STAMPED, optional=True, description="where it begins, instead of the robot's pose"),
        'planner_id': input_port(STRING, default='', description='planner to use'),
        'path': output_port(PATH, description='the path; empty when there is none'),
    }

    def make_goal(self) -> Any:
        start = self.get_input_or('start', None)
        return self.action_type.Goal(
            goals=list(self.get_input('goals')),
            start=start or PoseStamped(),
            use_start=start is not None,
            planner_id=str(self.get_input('planner_id')),
        )

    def on_success(self, result: Any) -> NodeStatus:
        self.set_output('path', result.path)
        return NodeStatus.SUCCESS

    def on_failure(self, outcome: GoalOutcome) -> None:
        self.set_output('path', Path())


class FollowPath(ActionLeaf):
    """Drives along ``path``. A new path or another controller on the blackboard replaces the goal without a stop."""

    __slots__ = ('_sent',)

    action_type = action.FollowPath
    default_server = names.FOLLOW_PATH
    ports = ACTION_PORTS | {
        'path': input_port(PATH, description='the path to follow'),
        'controller_id': input_port(STRING, default='', description='controller to use'),
        'goal_checker_id': input_port(STRING, default='', description='goal checker to use'),
        'progress_checker_id': input_port(STRING, default='', description='progress checker to use'),
    }

    def __init__(self, config: NodeConfig) -> None:
        super().__init__(config)
        self._sent: tuple[Any, ...] = ()

    def make_goal(self) -> Any:
        self._sent = self._wanted()
        path, controller, goal_checker, progress_checker = self._sent
        return self.action_type.Goal(
            path=path, controller_id=controller, goal_checker_id=goal_checker, progress_checker_id=progress_checker
        )

    def newer_goal(self, feedback: Any) -> Any | None:
        wanted = self._wanted()
        # The blackboard gives the same object until it is written again: no comparison of hundreds of poses.
        if wanted[0] is self._sent[0] and wanted[1:] == self._sent[1:]:
            return None
        return self.make_goal() if wanted[0].poses else None

    def _wanted(self) -> tuple[Any, ...]:
        inputs = ('controller_id', 'goal_checker_id', 'progress_checker_id')
        return (self.get_input('path'), *(str(self.get_input_or(port, '')) for port in inputs))


class _Recovery(ActionLeaf):
    """A leaf that counts as a recovery when it starts, in the blackboard key ``number_recoveries``."""

    __slots__ = ()

    def counts(self) -> bool:
        """Whether this start is a recovery."""
        return True

    def on_start(self) -> NodeStatus:
        if self.counts():
            count_recovery(self.blackboard)
        return super().on_start()


def count_recovery(board: Any) -> None:
    """Add one to the recoveries of the run."""
    count = board.root.get_or(RECOVERIES_KEY, 0)
    board.root.set(RECOVERIES_KEY, int(count) + 1)


_ALLOWANCE = input_port(DOUBLE, default='10.0', description='give up after this time, s; 0 for never')


class Spin(_Recovery):
    """Turns on the spot by ``spin_dist``."""

    __slots__ = ()

    action_type = action.Spin
    default_server = names.SPIN
    ports = ACTION_PORTS | {
        'spin_dist': input_port(DOUBLE, default='1.57', description='angle, rad, positive to the left'),
        'time_allowance': _ALLOWANCE,
        'is_recovery': input_port(BOOL, default='true', description='whether it counts as a recovery'),
    }

    def counts(self) -> bool:
        return bool(self.get_input('is_recovery'))

    def make_goal(self) -> Any:
        return self.action_type.Goal(
            target_yaw=float(self.get_input('spin_dist')),
            time_allowance=duration_message(self.get_input('time_allowance')),
        )

    def resumed_goal(self, goal: Any, feedback: Any) -> Any:
        turned = 0.0 if feedback is None else feedback.angular_distance_traveled
        goal.target_yaw = float(_rest(goal.target_yaw, turned))
        return goal


def _rest(whole: float, done: float) -> float:
    """What is left of a motion, of the sign that it has. Feedback comes now and then: what the robot has moved since
    the last, and while it braked, is moved once more.
    """
    return math.copysign(max(0.0, abs(whole) - abs(done)), whole)


def _rest_of_drive(goal: Any, feedback: Any) -> Any:
    if feedback is not None:
        goal.target.x = _rest(goal.target.x, feedback.distance_traveled)
    return goal


class BackUp(_Recovery):
    """Drives backward by ``backup_dist``."""

    __slots__ = ()

    action_type = action.BackUp
    default_server = names.BACKUP
    ports = ACTION_PORTS | {
        'backup_dist': input_port(DOUBLE, default='0.15', description='distance, m'),
        'backup_speed': input_port(DOUBLE, default='0.025', description='speed, m/s'),
        'time_allowance': _ALLOWANCE,
    }

    def make_goal(self) -> Any:
        return self.action_type.Goal(
            target=Point(x=float(self.get_input('backup_dist'))),
            speed=float(self.get_input('backup_speed')),
            time_allowance=duration_message(self.get_input('time_allowance')),
        )

    def resumed_goal(self, goal: Any, feedback: Any) -> Any:
        return _rest_of_drive(goal, feedback)


class DriveOnHeading(ActionLeaf):
    """Drives straight on by ``dist_to_travel``."""

    __slots__ = ()

    action_type = action.DriveOnHeading
    default_server = names.DRIVE_ON_HEADING
    ports = ACTION_PORTS | {
        'dist_to_travel': input_port(DOUBLE, default='0.15', description='distance, m; negative is backward'),
        'speed': input_port(DOUBLE, default='0.025', description='speed, m/s; of the same sign'),
        'time_allowance': _ALLOWANCE,
    }

    def make_goal(self) -> Any:
        return self.action_type.Goal(
            target=Point(x=float(self.get_input('dist_to_travel'))),
            speed=float(self.get_input('speed')),
            time_allowance=duration_message(self.get_input('time_allowance')),
        )

    def resumed_goal(self, goal: Any, feedback: Any) -> Any:
        return _rest_of_drive(goal, feedback)


class Wait(_Recovery):
    """Waits for ``wait_duration``, on the clock of the server."""

    __slots__ = ()

    action_type = action.Wait
    default_server = names.WAIT
    ports = ACTION_PORTS | {
        'wait_duration': input_port(DOUBLE, default='1.0', description='how long, s'),
    }

    def make_goal(self) -> Any:
        seconds = float(self.get_input('wait_duration'))
        if not (math.isfinite(seconds) and seconds > 0):
            raise ValueError(f'wait_duration has to be positive, not {seconds}')
        return self.action_type.Goal(time=duration_message(seconds))

    def resumed_goal(self, goal: Any, feedback: Any) -> Any:
        return goal if feedback is None else self.action_type.Goal(time=feedback.time_left)


NODES: Final = (
    ComputePathToPose,
    ComputePathThroughPoses,
    FollowPath,
    Spin,
    BackUp,
    DriveOnHeading,
    Wait,
)
