# SPDX-License-Identifier: BSD-3-Clause
"""Actions that plan: compute_path_to_pose and compute_path_through_poses, on a thread of their own; the service
is_path_valid; and the parameters of the planner with Nav2's names."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

from nav2_msgs.action import ComputePathThroughPoses, ComputePathToPose
from nav2_msgs.srv import IsPathValid
from nav_msgs.msg import Path

from flexbt_common import names
from flexbt_common.calls.goal_server import GoalServer, ServedGoal
from flexbt_common.middleware.received_messages import COMPLAINT_SECONDS
from flexbt_common.runtime.node_runtime import NodeRuntime
from flexbt_common.values.limits import check_limits
from flexbt_common.values.message_fields import duration_message, poses_of
from flexbt_core.errors import FlexbtError
from flexbt_core.values.parameter_fields import parameter
from flexbt_navigation.common.goals import SUCCEEDED, Computation, GoalEnd, OnPathEnd, finish
from flexbt_navigation.common.requests import Asked, asked_path, asked_pose, check_id, set_success
from flexbt_navigation.controller.server import ControllerParameters
from flexbt_navigation.errors import NavigationError
from flexbt_navigation.robot_interface import RobotInterface
from flexbt_sim.messages import path_message
from flexbt_sim.world.plane.geometry import Pose

from .grid_planner import StopFlag
from .hybrid_planner import planner_for


@dataclass
class PlannerParameters:
    """Parameters of the planner.

    While the servers run, ``tolerance`` may be set to another one, for the paths that are planned then. On the executor
    thread.
    """

    planner_ids: tuple[str, ...] = parameter('planner_ids', ('GridBased',), 'names under which the planner is known')
    tolerance: float = parameter(
        'tolerance', 0.0, 'how far from a goal that cannot be reached a path may end, m; 0: nowhere else', 0.0, 10.0
    )


class PlannerServer:
    """The server of both actions and the service. On the executor thread."""

    def __init__(
        self,
        runtime: NodeRuntime,
        parameters: PlannerParameters,
        controller: ControllerParameters,
        robot: RobotInterface,
    ) -> None:
        self._runtime = runtime
        self._parameters = parameters
        self._controller = controller
        self._robot = robot
        self._computation = Computation(runtime, 'planner')
        self._legs: list[list[Pose]] = []
        self._plan_topic = runtime.node.create_publisher(Path, names.PLAN, 1)
        actions = (
            (ComputePathToPose, names.COMPUTE_PATH_TO_POSE, lambda request: [request.goal]),
            (ComputePathThroughPoses, names.COMPUTE_PATH_THROUGH_POSES, lambda request: poses_of(request.goals)),
        )
        for action_type, name, goals_of in actions:
            self._serve(action_type, name, goals_of)
        runtime.node.create_service(IsPathValid, names.IS_PATH_VALID, self._is_path_valid)

    def _serve(self, action_type: Any, name: str, goals_of: Callable[[Any], Sequence[Any]]) -> None:
        def serve(goal: ServedGoal) -> None:
            began = self._runtime.steady.now()

            def on_end(end: GoalEnd, path: Path | None = None) -> None:
                result = action_type.Result()
                if path is not None:
                    result.path = path
                result.planning_time = duration_message(self._runtime.steady.now() - began)
                finish(goal, result, end)

            self._robot.with_poses(
                goal,
                lambda request: self._asked(request, goals_of(request)),
                lambda poses: self._search(goal, poses, on_end),
                on_end,
                'the planner',
            )

        GoalServer(self._runtime, action_type, name, serve)

    def _asked(self, request: Any, goals: Sequence[Any]) -> list[Asked]:
        """Return the goals, and the start behind them if there is one."""
        check_id(request.planner_id, self._parameters.planner_ids, 'planner', 'INVALID_PLANNER')
        if not goals:
            raise NavigationError('NO_VIAPOINTS_GIVEN', 'the goal has no poses')
        asked = [asked_pose(one, 'the goal', 'GOAL_OUTSIDE_MAP') for one in goals]
        return [*asked, asked_pose(request.start, 'the start', 'START_OUTSIDE_MAP')] if request.use_start else asked

    def _search(self, goal: ServedGoal, poses: list[Pose], on_end: OnPathEnd) -> None:
        start = poses.pop() if goal.request.use_start else self._robot.pose
        costmap, frame = self._robot.costmaps.shared, self._robot.parameters.map_frame
        planner = planner_for(costmap, self._controller.follower.steering, self._parameters.tolerance)
        stop = StopFlag()
        goal.on_cancel(stop.set)  # the search ends at once, in the midst of it

        def plan() -> Path:
            legs = self._legs = planner.plan_through(start, poses, stop, self._legs)
            path = [*(pose for leg in legs[:-1] for pose in leg[:-1]), *legs[-1]]
            return path_message(path, frame, self._runtime.clock.stamp())

        self._computation.run(goal, plan, lambda path: self._planned(path, on_end), on_end)

    def _planned(self, path: Path, on_end: OnPathEnd) -> None:
        self._plan_topic.publish(path)
        on_end(SUCCEEDED, path)

    async def _is_path_valid(self, request: Any, response: Any) -> Any:
        try:
            check_limits(request)
            poses = await self._robot.map_frame.known(asked_path(request.path))
            costmap, here = self._robot.costmaps.shared, self._robot.pose
        except FlexbtError as error:
            self._runtime.node.get_logger().warning(f'is_path_valid: {error}', throttle_duration_sec=COMPLAINT_SECONDS)
            return response
        if not poses:
            return response
        nearest = min(range(len(poses)), key=lambda index: here.distance(poses[index]))
        invalid = [index for index in range(nearest, len(poses)) if costmap.in_collision(poses[index])]
        response.is_valid = not invalid
        set_success(response)
        response.invalid_pose_indices = invalid
        return response
