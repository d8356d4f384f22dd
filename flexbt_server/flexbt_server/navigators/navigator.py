# SPDX-License-Identifier: BSD-3-Clause
"""A navigator: an action of Nav2 whose goals become runs of a tree, which finds poses on its blackboard."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any, Final

from geometry_msgs.msg import PoseStamped
from nav2_msgs.action import NavigateThroughPoses, NavigateToPose
from nav_msgs.msg import Path

from flexbt_common import names
from flexbt_common.calls import GoalAdmission, GoalServer, ServedGoal
from flexbt_common.errors import TransformError
from flexbt_common.runtime import NodeRuntime
from flexbt_common.transforms import TransformListener
from flexbt_common.values import duration_message, poses_of
from flexbt_core.behavior_tree import Tree
from flexbt_core.values import sendable
from flexbt_msgs.action import BtExecute
from flexbt_server.goals import (
    MESSAGE_LIMIT,
    MOST_COUNTED,
    RunningTree,
    Speed,
    TreeGoal,
    TreeGoals,
    distance_left,
    recoveries,
    seconds_left,
)
from flexbt_server.nav2 import concluded, pending
from flexbt_server.runs import RunOutcome
from flexbt_server.trees import (
    PATH,
    POSE_STAMPED,
    POSES,
    WAYPOINT_STATUSES,
    Blackboards,
    TrackingFeedback,
    Value,
)

from .parameters import NavigatorParameters

Code = BtExecute.Result

MOST_GOALS: Final = 200
"""Goals of a navigator that are worked on at a time; of a flood of them each replaces the one before."""

ACTIONS: Final = {names.NAVIGATE_TO_POSE: NavigateToPose, names.NAVIGATE_THROUGH_POSES: NavigateThroughPoses}
"""The action of each navigator."""

TRACKING_KEY: Final = 'tracking_feedback'
"""The key under which main's trees keep what the controller says of how the robot is on its path."""


class Navigator:
    """Serves one of :data:`ACTIONS`. On the executor thread.

    Its trees run on a blackboard of its own, which has the name of the action and lasts as long as the navigator.
    ``on_goal(goal, go_on)`` is told of each goal that is ready to begin, but for its poses.
    """

    def __init__(
        self,
        runtime: NodeRuntime,
        name: str,
        parameters: NavigatorParameters,
        goals: TreeGoals,
        boards: Blackboards,
        admission: GoalAdmission,
        on_goal: Callable[[NavigatorGoal, Callable[[], None]], None],
        on_cancel: Callable[[ServedGoal], None],
    ) -> None:
        self.name = name
        self.action_type: Any = ACTIONS[name]
        self.parameters = parameters
        self.speed = Speed()
        self.on_goal = on_goal
        self._board = boards.get(name)  # held, so that it stays
        self._runtime = runtime
        self._goals = goals
        GoalServer(runtime, self.action_type, name, self._serve, on_cancel, most=MOST_GOALS, admission=admission)

    def _serve(self, served: ServedGoal) -> None:
        self._goals.serve(NavigatorGoal(self, served, self._runtime.clock.now()))

    def statuses(self) -> list[Any]:
        """What has become of the poses so far, where trees keep account of it."""
        statuses = self._board.get_or(self.parameters.statuses_key, [])
        return statuses if isinstance(statuses, list) else []

    def in_global_frame(self, goal: NavigatorGoal) -> None:
        """Find the poses of a goal in the global frame; when one is not known in time, the goal ends."""
        frame = self.parameters.global_frame
        there: list[PoseStamped | None] = [None] * len(goal.asked)

        def known(index: int, pose: PoseStamped) -> None:
            there[index] = pose
            found = [pose for pose in there if pose is not None]
            if len(found) == len(there):
                goal.poses = found

        def unknown(error: TransformError) -> None:
            goal.problem = 'TF_ERROR'
            self._goals.end(goal, RunOutcome(Code.ERROR, f'the goal cannot be transformed to {frame!r}: {error}'))

        goal.poses = None if goal.asked else []
        for index, pose in enumerate(goal.asked):
            if pose.header.frame_id in ('', frame):
                known(index, pose)
            else:
                TransformListener.of(self._runtime).transform_pose(pose, frame, partial(known, index), unknown)


class NavigatorGoal(TreeGoal):
    """A goal of a navigator. ``poses`` are those that it asks for, in the global frame, once they are known.

    ``problem`` is the name of the error code, where the action has one, of a goal that ends before its tree has run.
    """

    def __init__(self, navigator: Navigator, served: ServedGoal, accepted: float) -> None:
        request = served.request
        tree = request.behavior_tree or navigator.parameters.default_trees[navigator.name]
        super().__init__(served, accepted, navigator.name, tree, navigator.name)
        self.navigator = navigator
        self.asked: list[PoseStamped] = [request.pose] if hasattr(request, 'pose') else poses_of(request.poses)
        self.poses: list[PoseStamped] | None = None
        self.problem = 'FAILED_TO_LOAD_BEHAVIOR_TREE'

    def read(self) -> list[Value]:
        return []

    def fresh_values(self) -> list[Value]:
        # A tree that begins does not drive the path of the goal before. One that is taken over drives on, on the path
        # that it has, until it plans anew.
        return [(self.navigator.parameters.path_key, Path(), PATH)]

    def when_ready(self, go_on: Callable[[], None]) -> None:
        self.problem = 'UNKNOWN'
        self.navigator.in_global_frame(self)
        if self.served.active:
            self.navigator.on_goal(self, go_on)

    def begin(self) -> None:
        """The poses are known, and it is the goal's turn."""
        assert self.poses is not None
        parameters = self.navigator.parameters
        if self.navigator.action_type is NavigateToPose:
            self.values = [(parameters.goal_key, self.poses[0], POSE_STAMPED)]
        else:
            self.values = [
                (parameters.goals_key, self.poses, POSES),
                (parameters.statuses_key, pending(self.poses), WAYPOINT_STATUSES),
            ]

    def feedback(self, running: RunningTree, tree: Tree, pose: PoseStamped, seconds: float) -> Any:
        board, parameters = running.run.board, self.navigator.parameters
        distance = distance_left(board.get_or(parameters.path_key, None), pose)
        feedback = self.navigator.action_type.Feedback(
            current_pose=pose,
            navigation_time=duration_message(seconds),
            estimated_time_remaining=duration_message(seconds_left(distance, self.navigator.speed.at(pose))),
            number_of_recoveries=recoveries(board),
            distance_remaining=float(distance),
        )
        if hasattr(feedback, 'number_of_poses_remaining'):
            poses = board.get_or(parameters.goals_key, [])
            feedback.number_of_poses_remaining = min(len(poses) if isinstance(poses, list) else 0, MOST_COUNTED)
        if hasattr(feedback, 'position_tracking_error'):  # as in main
            tracked = board.get_or(TRACKING_KEY, TrackingFeedback())
            feedback.position_tracking_error = tracked.position_tracking_error
            feedback.heading_tracking_error = tracked.heading_tracking_error
        if hasattr(feedback, 'waypoint_statuses'):
            feedback.waypoint_statuses = self.navigator.statuses()
        return feedback

    def result(self, outcome: RunOutcome, seconds: float) -> tuple[int, Any]:
        result = self.navigator.action_type.Result()
        if hasattr(result, 'waypoint_statuses'):
            succeeded = outcome.code == Code.SUCCESS
            result.waypoint_statuses = concluded(self.navigator.statuses(), succeeded=succeeded)
        if outcome.code != Code.SUCCESS:
            code = outcome.error_code
            if outcome.code == Code.ERROR and not code:
                code = getattr(result, self.problem, 0)  # Jazzy's actions have none of these
            result.error_code = code
            remarks = (outcome.message, self.notice)
            result.error_msg = sendable('; '.join(filter(None, remarks)), MESSAGE_LIMIT)
        return outcome.code, result

    def fault_result(self, why: str) -> Any:
        result = self.navigator.action_type.Result()
        result.error_code, result.error_msg = getattr(result, 'UNKNOWN', 0), why
        return result
