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
from flexbt_sim.action_results import CANCELED, RESULT_TIMEOUT, SUCCEEDED, GoalEnd, finish
from flexbt_sim.costmap import Costmap
from flexbt_sim.errors import NavigationError
from flexbt_sim.geometry import Pose
from flexbt_sim.navigation_parameters import NavigationParameters
from flexbt_sim.planner import GridPlanner
from flexbt_sim.request_checks import check_id, pose_in_map
from flexbt_sim.robot_interface import RobotInterface
from flexbt_sim.ros_messages import duration_message, path_message


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
        self._planner: tuple[Costmap, GridPlanner] | None = None
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
        end = CANCELED
        try:
            planned = await self._planned(handle, goals)
            if planned and not handle.is_cancel_requested:
                stamp = self._runtime.clock.stamp()
                result.path = path_message(planned, self._parameters.map_frame, stamp)
                self._plan_topic.publish(result.path)
                end = SUCCEEDED
        except NavigationError as error:
            end = GoalEnd(code=error.code, message=str(error))
        except Exception as error:
            self._runtime.report_fault(error, 'the planner')
            end = GoalEnd(code='UNKNOWN', message=f'fault in the planner: {error!r}')
        result.planning_time = duration_message(self._runtime.steady.now() - began)
        return finish(handle, result, end)

    async def _planned(self, handle: ServerGoalHandle, goals: Sequence[Any]) -> list[Pose]:
        """The path; empty when the goal is canceled meanwhile."""
        await self._robot.known()
        if handle.is_cancel_requested:
            return []
        start, poses = self._checked(handle.request, goals)
        return await self._in_thread(handle, self._robot.costmap, start, poses)

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

    def _in_thread(self, handle: ServerGoalHandle, costmap: Costmap, start: Pose, goals: Sequence[Pose]) -> Future:
        future = Future(executor=self._runtime.node.executor)

        def work() -> None:
            try:
                path = [] if handle.is_cancel_requested else self._plan(costmap, start, goals)
            except Exception as error:
                failure = error
                self._runtime.post(lambda: future.set_exception(failure))
            else:
                self._runtime.post(lambda: future.set_result(path))

        self._pool.submit(work)
        return future

    def _plan(self, costmap: Costmap, start: Pose, goals: Sequence[Pose]) -> list[Pose]:
        """On the thread of the planner."""
        if self._planner is None or self._planner[0] is not costmap:
            self._planner = costmap, GridPlanner(costmap)
        planner = self._planner[1]
        path: list[Pose] = []
        here = start
        for goal in goals:
            # A leg begins with the place where the one before it ends.
            path[-1:] = planner.plan(here, goal)
            here = goal
        return path
