# SPDX-License-Identifier: BSD-3-Clause
"""Planning actions: compute_path_to_pose and compute_path_through_poses, each on a separate thread, and smooth_path.
Also the service is_path_valid, and the parameters of the planner with Nav2's names."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any, Final

from nav2_msgs.action import ComputePathThroughPoses, ComputePathToPose, SmoothPath
from nav2_msgs.srv import IsPathValid
from nav_msgs.msg import Path

from flexbt_common import names
from flexbt_common.calls.goal_server import GoalServer, ServedGoal
from flexbt_common.middleware.received_messages import COMPLAINT_SECONDS
from flexbt_common.runtime.node_runtime import NodeRuntime
from flexbt_common.values.limits import check_limits
from flexbt_common.values.message_fields import duration_message, poses_of, seconds_of
from flexbt_core.errors import FlexbtError
from flexbt_core.values.parameter_fields import parameter
from flexbt_navigation.common.requests import Asked, Computation, asked_path, asked_pose, check_id, served, set_success
from flexbt_navigation.controller.server import ControllerParameters
from flexbt_navigation.errors import NavigationError
from flexbt_navigation.robot_interface import RobotInterface
from flexbt_sim.messages import path_message, pose_message
from flexbt_sim.world.plane.geometry import Pose

from .planners import StopFlag, planner_for
from .smoother import Smoothing, smooth_path


@dataclass
class PlannerParameters:
    """Parameters of the planner.

    ``tolerance`` can be changed while the servers run; it applies to later plans. Executor thread only.
    """

    planner_ids: tuple[str, ...] = parameter('planner_ids', ('GridBased',), 'names under which the planner is known')
    tolerance: float = parameter(
        'tolerance', 0.0, 'distance from an unreachable goal at which a path may end, m; 0: none', 0.0, 10.0
    )


class PlannerServer:
    """The server of both actions and the service. Executor thread only."""

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
            work = partial(self._plan, goals_of)
            GoalServer(runtime, action_type, name, served(runtime, action_type, 'planning_time', 'the planner', work))
        runtime.node.create_service(IsPathValid, names.IS_PATH_VALID, self._is_path_valid)

    def _asked(self, request: Any, goals: Sequence[Any]) -> list[Asked]:
        """Return the goals, followed by the start if the request has one."""
        check_id(request.planner_id, self._parameters.planner_ids, 'planner', 'INVALID_PLANNER')
        if not goals:
            raise NavigationError('NO_VIAPOINTS_GIVEN', 'the goal has no poses')
        asked = [asked_pose(one, 'the goal', 'GOAL_OUTSIDE_MAP') for one in goals]
        return [*asked, asked_pose(request.start, 'the start', 'START_OUTSIDE_MAP')] if request.use_start else asked

    async def _plan(self, goals_of: Callable[[Any], Sequence[Any]], goal: ServedGoal) -> dict[str, Any]:
        poses = await self._robot.poses(goal, lambda request: self._asked(request, goals_of(request)))
        start_asked = poses.pop() if goal.request.use_start else None
        frame, stop = self._robot.parameters.map_frame, StopFlag()
        goal.on_cancel(stop.set)  # the search stops immediately

        def prepare() -> Callable[[], Path]:
            start = start_asked or self._robot.pose
            steering = self._controller.follower.steering
            planner = planner_for(self._robot.costmaps.shared, steering, self._parameters.tolerance)

            def plan() -> Path:
                legs = self._legs = planner.plan_through(start, poses, stop, self._legs)
                path = [*(pose for leg in legs[:-1] for pose in leg[:-1]), *legs[-1]]
                return path_message(path, frame, self._runtime.clock.stamp())

            return plan

        path = await self._computation.run(prepare, goal)
        self._plan_topic.publish(path)
        return {'path': path}

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


SMOOTHERS: Final = {'simple_smoother': Smoothing(2), 'route_smoother': Smoothing(5, keeps_reversals=False)}
"""Smoothers of Nav2's bringup. The second is for routes, whose corners may be cut. The first is the default."""


class SmootherServer:
    """The server of smooth_path. Executor thread only."""

    def __init__(self, runtime: NodeRuntime, robot: RobotInterface) -> None:
        self._robot = robot
        self._computation = Computation(runtime, 'the smoother')
        self._smoothed = runtime.node.create_publisher(Path, names.PLAN_SMOOTHED, 1)
        # A cancel takes effect when the path is smooth.
        work = served(runtime, SmoothPath, 'smoothing_duration', 'the smoother', self._smooth)
        GoalServer(runtime, SmoothPath, names.SMOOTH_PATH, work)

    async def _smooth(self, goal: ServedGoal) -> dict[str, Any]:
        request = goal.request
        began = time.monotonic()

        def asked(request: Any) -> list[Asked]:
            check_id(request.smoother_id, tuple(SMOOTHERS), 'smoother', 'INVALID_SMOOTHER')
            return asked_path(request.path)

        poses = await self._robot.poses(goal, asked)
        costmap = self._robot.costmaps.shared
        smoothing = SMOOTHERS[request.smoother_id or next(iter(SMOOTHERS))]
        limit = seconds_of(request.max_smoothing_duration)

        def prepare() -> Callable[[], list[Pose]]:
            nonlocal began, costmap
            began, costmap = time.monotonic(), self._robot.costmaps.shared
            return partial(smooth_path, poses, costmap, smoothing, check_time)

        def check_time() -> None:
            if goal.cancel_requested or time.monotonic() - began > limit:
                raise NavigationError('TIMEOUT', f'the path is not smooth after {limit:g} s')

        smoothed = await self._computation.run(prepare, goal)
        path = _with_poses(request.path, smoothed, self._robot.parameters.map_frame)
        self._smoothed.publish(path)
        fields = {'path': path, 'was_completed': True, 'smoothing_duration': duration_message(time.monotonic() - began)}
        for pose in smoothed if request.check_for_collisions else ():
            if costmap.in_collision(pose):
                said = f'the path is in collision at ({pose.x:.2f}, {pose.y:.2f})'
                raise NavigationError('SMOOTHED_PATH_IN_COLLISION', said, **fields)
        return fields


def _with_poses(path: Path, poses: Sequence[Pose], frame: str) -> Path:
    """Return a copy of the message with other poses, in the map frame; stamps and heights are kept."""
    path.header.frame_id = frame
    for stamped, pose in zip(path.poses, poses, strict=True):
        stamped.header.frame_id = frame
        height = stamped.pose.position.z
        stamped.pose = pose_message(pose)
        stamped.pose.position.z = height
    return path
