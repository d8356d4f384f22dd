# SPDX-License-Identifier: BSD-3-Clause
"""The node ``navigation``: navigation servers with the interfaces of Nav2, for the simulated robot.

Actions compute_path_to_pose, compute_path_through_poses, smooth_path, follow_path, spin, backup, drive_on_heading,
assisted_teleop, wait, compute_route, compute_and_track_route, dock_robot and undock_robot; services of the costmaps, of
the route server and of the docking server, and is_path_valid. The simulator can have each server refuse goals, fail,
hang, or die. While a node of the parameter ``owner_nodes`` is late the robot is held; when it is gone every goal is
ended: nobody is left to stop it.
"""

from __future__ import annotations

import math
import sys
from functools import partial
from typing import Any, Final

from nav2_msgs.action import BackUp, DriveOnHeading, FollowPath, Spin
from nav2_msgs.msg import SpeedLimit
from nav2_msgs.srv import IsPathValid

from flexbt_common import names
from flexbt_common.calls import GoalAdmission, goal_servers
from flexbt_common.lifecycle import SHUTTING_DOWN
from flexbt_common.liveness import LivelinessToken, LivelinessWatch
from flexbt_common.runtime import COMPLAINT_SECONDS, Hang, NodeRuntime, run_node
from flexbt_common.values import check_limits, seconds_of
from flexbt_core.errors import FlexbtError
from flexbt_sim.intra_process import IntraProcessTopics
from flexbt_sim.navigation import DriveMotion, PathFollower, SpinMotion, prepare_navigation
from flexbt_sim.navigation_errors import NavigationError
from flexbt_sim.route_server import RouteServer
from flexbt_sim.server_common import (
    GoalEnd,
    MotionArbiter,
    MotionServer,
    RobotInterface,
    asked_path,
    bounded,
    check_id,
    declare_navigation_parameters,
    finish,
    following,
    set_success,
)
from flexbt_sim.world import Pose

from .collision_monitor import CollisionMonitor
from .docking_server import DockingServer
from .managed_servers import manage_servers
from .planner_server import PlannerServer
from .server_faults import ServerFaults
from .smoother_server import SmootherServer
from .teleop_server import TeleopServer
from .wait_server import WaitServer

MOST_TURN: Final = 10_000.0
MOST_DISTANCE: Final = 100_000.0
MOST_SPEED: Final = 10.0
"""Of one motion: rad, m, m/s. For each pose of the robot collisions are looked for over two seconds of driving."""


class Navigation:
    """The servers on a running node."""

    def __init__(self, runtime: NodeRuntime, in_process: IntraProcessTopics | None = None) -> None:
        """Must be called off the executor thread. ``in_process``: the topics of a robot that is simulated in this
        process.

        Raises:
            FlexbtError: a parameter cannot work.
        """
        self._runtime = runtime
        self._parameters = runtime.call(lambda: declare_navigation_parameters(runtime.node))
        prepare_navigation(self._parameters.follower.steering, self._parameters.inflation)
        runtime.call(lambda: self._serve(in_process))
        timeout = self._parameters.peer_timeout
        self._owners = [
            LivelinessWatch(runtime, owner, partial(self._on_owner, owner), on_late=self._on_late, timeout=timeout)
            for owner in self._parameters.owner_nodes
        ]
        for robot in self._parameters.robot_nodes:
            LivelinessWatch(runtime, robot, partial(self._on_robot, robot), timeout=timeout)
        runtime.on_close(self._close)
        runtime.health.on_hang(self._after_hang)
        LivelinessToken(runtime).set_ready(True)
        runtime.node.get_logger().info('ready')

    def _serve(self, in_process: IntraProcessTopics | None) -> None:
        runtime = self._runtime
        self._robot = RobotInterface(runtime, self._parameters, in_process)
        self._arbiter = MotionArbiter(runtime, self._robot)
        PlannerServer(runtime, self._parameters, self._robot)
        motions = (
            (
                FollowPath,
                names.FOLLOW_PATH,
                self._follow,
                lambda motion: following(motion, self._robot.pose, self._parameters.map_frame, runtime.clock.stamp()),
                lambda request: asked_path(request.path),
            ),
            (
                Spin,
                names.SPIN,
                self._spin,
                lambda motion: Spin.Feedback(angular_distance_traveled=float(motion.turned)),
            ),
            (
                BackUp,
                names.BACKUP,
                self._back_up,
                lambda motion: BackUp.Feedback(distance_traveled=float(motion.driven)),
            ),
            (
                DriveOnHeading,
                names.DRIVE_ON_HEADING,
                self._drive,
                lambda motion: DriveOnHeading.Feedback(distance_traveled=float(motion.driven)),
            ),
        )
        for motion in motions:
            MotionServer(runtime, self._arbiter, *motion)
        SmootherServer(runtime, self._parameters, self._robot)
        TeleopServer(runtime, self._parameters, self._arbiter)
        self._routes = RouteServer(runtime, self._parameters, self._robot)
        CollisionMonitor(runtime, self._parameters, self._arbiter)
        DockingServer(runtime, self._parameters, self._arbiter)
        self._waits = WaitServer(runtime)
        ServerFaults(runtime)
        manage_servers(runtime, self._parameters)
        self._speed_limit = math.inf
        runtime.node.create_subscription(SpeedLimit, names.SPEED_LIMIT, self._limit_speed, 10)
        runtime.node.create_service(IsPathValid, names.IS_PATH_VALID, self._is_path_valid)

    # -- motions -----------------------------------------------------------------------------------------------------

    def _follow(self, request: Any, *path: Pose) -> PathFollower:
        parameters = self._parameters
        check_id(request.controller_id, parameters.controller_ids, 'controller', 'INVALID_CONTROLLER')
        check_id(request.goal_checker_id, parameters.goal_checker_ids, 'goal checker', 'UNKNOWN')
        check_id(request.progress_checker_id, parameters.progress_checker_ids, 'progress checker', 'UNKNOWN')
        running = self._arbiter.running
        before = running.motion if running is not None and isinstance(running.motion, PathFollower) else None
        drift = self._robot.map_frame.drift(request.path.header)
        follower = PathFollower(path, self._robot.costmaps.local, parameters.follower, before, drift)
        follower.speed_limit = self._speed_limit
        return follower

    def _limit_speed(self, message: SpeedLimit) -> None:
        """As Nav2's controller server: a share of the desired speed in percent, or m/s; 0 for no limit."""
        limit = float(message.speed_limit)
        if not 0.0 <= limit < math.inf:
            self._runtime.node.get_logger().error(
                f'{names.SPEED_LIMIT}: {limit:g} is no limit of the speed: ignored',
                throttle_duration_sec=COMPLAINT_SECONDS,
            )
            return
        share = self._parameters.follower.speed / 100.0 if message.percentage else 1.0
        self._speed_limit = limit * share or math.inf
        running = self._arbiter.running
        if running is not None and isinstance(running.motion, PathFollower):
            running.motion.speed_limit = self._speed_limit

    def _spin(self, request: Any) -> SpinMotion:
        radius = self._parameters.follower.turning_radius
        if radius:
            raise NavigationError('UNKNOWN', f'a robot with a minimum_turning_radius of {radius:g} m cannot spin')
        return SpinMotion(
            bounded(request.target_yaw, 'target_yaw', MOST_TURN),
            seconds_of(request.time_allowance),
            self._robot.costmaps.local,
        )

    def _back_up(self, request: Any) -> DriveMotion:
        return self._straight(-abs(request.target.x), -abs(request.speed), request)

    def _drive(self, request: Any) -> DriveMotion:
        return self._straight(request.target.x, request.speed, request)

    def _straight(self, distance: float, speed: float, request: Any) -> DriveMotion:
        bounded(distance, 'target.x', MOST_DISTANCE)
        bounded(speed, 'speed', MOST_SPEED)
        if request.target.y or request.target.z:
            raise NavigationError(
                'INVALID_INPUT', 'only straight motions are possible: target.y and target.z have to be 0'
            )
        if speed == 0.0:
            raise NavigationError('INVALID_INPUT', 'the speed is 0')
        if distance * speed < 0.0:
            raise NavigationError('INVALID_INPUT', f'distance {distance:g} and speed {speed:g} have opposite signs')
        return DriveMotion(distance, speed, seconds_of(request.time_allowance), self._robot.costmaps.local)

    # -- services ----------------------------------------------------------------------------------------------------

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

    # -- the end of everything ---------------------------------------------------------------------------------------

    def _on_owner(self, owner: str, alive: bool) -> None:
        if not alive:
            self._end_all(f'{owner}, which gives the goals, is gone: it has ended or died, or was late for too long')

    def _on_late(self, _is_late: bool) -> None:
        late = [owner for owner in self._owners if owner.late]
        self._arbiter.hold(bool(late))
        if self._arbiter.running is not None:
            told = '; '.join(f'{owner.node_name} is late: {owner.problem}' for owner in late)
            self._runtime.node.get_logger().warning(f'the robot is held: {told}' if told else 'the robot goes on')

    def _on_robot(self, robot: str, alive: bool) -> None:
        if not alive:
            self._robot.forget_pose()
            self._end_all(f'no pose of the robot: {robot} is gone', code='TF_ERROR')

    def _after_hang(self, hang: Hang) -> None:
        """The process was stopped: what was asked of it meanwhile may be lost, a cancel too. Called on any thread."""
        if hang.was_out_of_reach:
            self._runtime.post(lambda: self._end_all(str(hang)))

    def _close(self) -> None:
        self._runtime.call(self._end)
        for _ in range(2):  # on one turn of the executor the goals end, on the next their results leave
            self._runtime.call(lambda: None)

    def _end(self) -> None:
        admission = GoalAdmission(names.NAVIGATION, SHUTTING_DOWN)
        for server in goal_servers(self._runtime).values():
            server.admission = admission
        self._end_all(admission.refusal)

    def _end_all(self, reason: str, code: str = 'UNKNOWN') -> None:
        servers = list(goal_servers(self._runtime).values())
        if any(server.busy for server in servers):
            self._runtime.node.get_logger().error(f'every goal is ended: {reason}')
        end = GoalEnd(code=code, message=reason)
        self._arbiter.end(end)
        self._waits.end_all(end)
        self._routes.end_all(end)
        for server in servers:  # what else goes on: a search, or a goal that waits for the pose or a transform
            server.end_all(partial(finish, end=end))


def main(args: list[str] | None = None) -> int:
    """Entry point of the executable ``navigation``."""
    return run_node(names.NAVIGATION, Navigation, args, about=__doc__)


if __name__ == '__main__':
    sys.exit(main())
