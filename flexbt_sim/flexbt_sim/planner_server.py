# SPDX-License-Identifier: BSD-3-Clause
"""Actions that plan: compute_path_to_pose and compute_path_through_poses. Planning happens on a thread of its own."""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any

from nav_msgs.msg import Path
from rclpy.action import ActionServer, CancelResponse, GoalResponse
from rclpy.action.server import ServerGoalHandle
from rclpy.task import Future

from flexbt_common import names
from flexbt_common.navigation_interfaces import NavigationInterfaces
from flexbt_common.node_runtime import NodeRuntime
from flexbt_sim.errors import NavigationError
from flexbt_sim.geometry import Pose
from flexbt_sim.motion_server import RESULT_TIMEOUT
from flexbt_sim.navigation_parameters import NavigationParameters
from flexbt_sim.planner import GridPlanner
from flexbt_sim.robot_interface import RobotInterface
from flexbt_sim.ros_messages import duration_message, path_message, pose_of


class PlannerServer:
    """Serves both actions."""

    def __init__(
        self,
        runtime: NodeRuntime,
        parameters: NavigationParameters,
        interfaces: NavigationInterfaces,
        robot: RobotInterface,
    ) -> None:
        self._runtime = runtime
        self._parameters = parameters
        self._robot = robot
        self._pool = ThreadPoolExecutor(max_workers=1, thread_name_prefix='planner')
        self._plan_topic = runtime.node.create_publisher(Path, names.PLAN, 1)
        runtime.on_close(lambda: self._pool.shutdown(wait=False, cancel_futures=True))
        actions = (
            (interfaces.ComputePathToPose, names.COMPUTE_PATH_TO_POSE, lambda request: [request.goal]),
            (interfaces.ComputePathThroughPoses, names.COMPUTE_PATH_THROUGH_POSES, lambda request: list(request.goals)),
        )
        for action_type, name, goals_of in actions:
            self._serve(action_type, name, goals_of)

    def _serve(self, action_type: Any, name: str, goals_of: Any) -> None:
        async def execute(handle: ServerGoalHandle) -> Any:
            return await self._execute(handle, action_type, goals_of(handle.request))

        server = ActionServer(
            self._runtime.node,
            action_type,
            name,
            execute,
            goal_callback=lambda request: GoalResponse.ACCEPT,
            cancel_callback=lambda handle: CancelResponse.ACCEPT,
            result_timeout=RESULT_TIMEOUT,
            **names.deep_action_services(),
        )
        self._runtime.on_close(lambda: self._runtime.call(server.destroy))

    async def _execute(self, handle: ServerGoalHandle, action_type: Any, goals: Sequence[Any]) -> Any:
        began = self._runtime.steady.now()
        result = action_type.Result()
        await self._robot.known()
        try:
            start, poses = self._checked(handle.request, goals)
            planned = await self._in_thread(self._robot.planner, start, poses)
        except NavigationError as error:
            result.error_code = int(getattr(action_type.Result, error.code, action_type.Result.UNKNOWN))
            result.error_msg = str(error)
            handle.abort()
            return result
        result.planning_time = duration_message(self._runtime.steady.now() - began)
        if handle.is_cancel_requested:
            handle.canceled()
            return result
        result.path = path_message(planned, self._parameters.map_frame, self._runtime.node.get_clock().now().to_msg())
        self._plan_topic.publish(result.path)
        handle.succeed()
        return result

    def _checked(self, request: Any, goals: Sequence[Any]) -> tuple[Pose, list[Pose]]:
        parameters = self._parameters
        if request.planner_id and request.planner_id not in parameters.planner_ids:
            known = ', '.join(parameters.planner_ids)
            raise NavigationError('INVALID_PLANNER', f'there is no planner {request.planner_id!r}; known: {known}')
        if not goals:
            raise NavigationError('NO_VIAPOINTS_GIVEN', 'the goal has no poses')
        stamped = [*goals, request.start] if request.use_start else list(goals)
        for pose in stamped:
            if pose.header.frame_id not in ('', parameters.map_frame):
                raise NavigationError(
                    'TF_ERROR', f'no transform from frame {pose.header.frame_id!r} to {parameters.map_frame!r} is known'
                )
        start = pose_of(request.start.pose) if request.use_start else self._robot.pose
        return start, [pose_of(goal.pose) for goal in goals]

    def _in_thread(self, planner: GridPlanner, start: Pose, goals: Sequence[Pose]) -> Future:
        future = Future(executor=self._runtime.node.executor)

        def work() -> None:
            try:
                path: list[Pose] = []
                here = start
                for goal in goals:
                    leg = planner.plan(here, goal)
                    path += leg[1:] if path else leg
                    here = goal
            except Exception as error:
                failure = error
                self._runtime.post(lambda: future.set_exception(failure))
            else:
                self._runtime.post(lambda: future.set_result(path))

        self._pool.submit(work)
        return future
