# SPDX-License-Identifier: BSD-3-Clause
"""Actions that plan: compute_path_to_pose and compute_path_through_poses. Planning happens on a thread of its own."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any, Protocol

from nav2_msgs.action import ComputePathThroughPoses, ComputePathToPose
from nav_msgs.msg import Path

from flexbt_common import names
from flexbt_common.calls import GoalServer, ServedGoal
from flexbt_common.runtime import NodeRuntime
from flexbt_common.values import duration_message
from flexbt_sim.errors import NavigationError
from flexbt_sim.navigation import Costmap, GridPlanner
from flexbt_sim.world import Pose

from .action_results import CANCELED, SUCCEEDED, GoalEnd, end_by, finish
from .navigation_parameters import NavigationParameters
from .request_checks import check_id, pose_in_map
from .robot_interface import RobotInterface
from .ros_messages import path_message


class OnEnd(Protocol):
    """Ends a goal, with a path when there is one."""

    def __call__(self, end: GoalEnd, path: Path | None = None) -> None: ...


class PlannerServer:
    """Serves both actions."""

    def __init__(
        self,
        runtime: NodeRuntime,
        parameters: NavigationParameters,
        robot: RobotInterface,
    ) -> None:
        self._runtime = runtime
        self._parameters = parameters
        self._robot = robot
        self._planner: tuple[Costmap, GridPlanner] | None = None
        self._pool = ThreadPoolExecutor(max_workers=1, thread_name_prefix='planner')
        self._plan_topic = runtime.node.create_publisher(Path, names.PLAN, 1)
        runtime.on_close(lambda: self._pool.shutdown(wait=False, cancel_futures=True))
        actions = (
            (ComputePathToPose, names.COMPUTE_PATH_TO_POSE, lambda request: [request.goal]),
            (ComputePathThroughPoses, names.COMPUTE_PATH_THROUGH_POSES, lambda request: list(request.goals)),
        )
        for action_type, name, goals_of in actions:
            self._serve(action_type, name, goals_of)

    def _serve(self, action_type: Any, name: str, goals_of: Callable[[Any], Sequence[Any]]) -> None:
        def serve(goal: ServedGoal) -> None:
            began = self._runtime.steady.now()

            def on_end(end: GoalEnd, path: Path | None = None) -> None:
                result = action_type.Result()
                if path is not None:
                    result.path = path
                result.planning_time = duration_message(self._runtime.steady.now() - began)
                finish(goal, result, end)

            self._robot.when_known(lambda: self._plan(goal, goals_of(goal.request), on_end))

        # A goal that is to be canceled ends when the leg is planned that is being planned.
        server = GoalServer(self._runtime, action_type, name, serve, on_cancel=lambda goal: None)
        self._runtime.on_close(lambda: self._runtime.call(server.close))

    def _plan(self, goal: ServedGoal, goals: Sequence[Any], on_end: OnEnd) -> None:
        def failed(error: Exception) -> None:
            on_end(end_by(self._runtime, error, 'the planner'))

        if goal.cancel_requested:
            on_end(CANCELED)
            return
        try:
            start, poses = self._checked(goal.request, goals)
            costmap = self._robot.costmap
        except Exception as error:
            failed(error)
            return

        def work() -> None:
            try:
                path = self._path(costmap, start, poses, lambda: goal.cancel_requested)
            except Exception as error:
                reason = error
                self._runtime.post(lambda: failed(reason))
            else:
                self._runtime.post(lambda: self._planned(goal, path, on_end))

        self._pool.submit(work)

    def _planned(self, goal: ServedGoal, path: list[Pose], on_end: OnEnd) -> None:
        if goal.cancel_requested:
            on_end(CANCELED)
            return
        message = path_message(path, self._parameters.map_frame, self._runtime.clock.stamp())
        self._plan_topic.publish(message)
        on_end(SUCCEEDED, message)

    def _checked(self, request: Any, goals: Sequence[Any]) -> tuple[Pose, list[Pose]]:
        parameters = self._parameters
        frame = parameters.map_frame
        check_id(request.planner_id, parameters.planner_ids, 'planner', 'INVALID_PLANNER')
        if not goals:
            raise NavigationError('NO_VIAPOINTS_GIVEN', 'the goal has no poses')
        poses = [pose_in_map(goal, frame, 'the goal', 'GOAL_OUTSIDE_MAP') for goal in goals]
        if request.use_start:
            return pose_in_map(request.start, frame, 'the start', 'START_OUTSIDE_MAP'), poses
        return self._robot.pose, poses

    def _path(
        self, costmap: Costmap, start: Pose, goals: Sequence[Pose], is_unwanted: Callable[[], bool]
    ) -> list[Pose]:
        """On the thread of the planner. Of a path that nobody wants any more the rest is left out."""
        if self._planner is None or self._planner[0] is not costmap:
            self._planner = costmap, GridPlanner(costmap)
        planner = self._planner[1]
        path: list[Pose] = []
        here = start
        for goal in goals:
            if is_unwanted():
                break
            # A leg begins with the place where the one before it ends.
            path[-1:] = planner.plan(here, goal)
            here = goal
        return path
