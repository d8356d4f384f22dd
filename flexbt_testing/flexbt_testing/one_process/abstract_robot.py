# SPDX-License-Identifier: BSD-3-Clause
"""A robot for tests of missions that do not depend on motion: a drive takes its distance divided by the speed.

It stands in for simulator and navigation: the actions of Nav2 that trees use, the map, the pose and the odometry. It
drives straight from point to point, through walls, and has no scan, no battery and no /clock.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial
from itertools import accumulate, pairwise
from typing import Any, Final

import yaml
from builtin_interfaces.msg import Time
from geometry_msgs.msg import PoseStamped, PoseWithCovarianceStamped
from nav2_msgs.action import (
    BackUp,
    ComputePathThroughPoses,
    ComputePathToPose,
    DockRobot,
    DriveOnHeading,
    FollowPath,
    SmoothPath,
    Spin,
    UndockRobot,
    Wait,
)
from nav2_msgs.srv import ClearEntireCostmap
from nav_msgs.msg import OccupancyGrid, Odometry, Path

from flexbt_common import names
from flexbt_common.calls.goal_server import GoalFault, GoalServer, ServedGoal
from flexbt_common.lifecycle.lifecycle_subnode import LifecycleSubnode
from flexbt_common.lifecycle.liveliness import LivelinessToken, LivelinessWatch
from flexbt_common.runtime.node_runtime import NodeRuntime, run_node
from flexbt_common.values.message_fields import seconds_of
from flexbt_core.clock.clock import Timer
from flexbt_msgs.srv import SetFault
from flexbt_sim.messages import grid_message, pose_of, stamped
from flexbt_sim.world import Pose
from flexbt_sim.world.plane.occupancy_map import OccupancyMap

from .scheduler import SCHEDULER

_POSE_SECONDS: Final = 0.5
"""Time from one pose, and one feedback of a drive, to the next, s; the end of a drive tells its pose at once."""

_REST_SECONDS: Final = 0.05
"""Time from the end of a drive until a second pose shows that the robot is at rest, s."""

_PLAN_SECONDS: Final = 0.05
_TASK_SECONDS: Final = 1.0
"""Time that a plan, and a task that is no drive, takes, s."""

_TASKS: Final = {
    names.SPIN: Spin,
    names.BACKUP: BackUp,
    names.DRIVE_ON_HEADING: DriveOnHeading,
    names.DOCK_ROBOT: DockRobot,
    names.UNDOCK_ROBOT: UndockRobot,
}


class AbstractRobot:
    """The robot, on the executor thread of its node. ``pose`` is where it begins, ``speed`` in m/s."""

    def __init__(self, runtime: NodeRuntime, map: OccupancyMap, pose: Pose, speed: float) -> None:
        self._runtime, self._speed = runtime, speed
        self._pose = pose
        self._drive: tuple[ServedGoal, list[Pose], float] | None = None
        """The goal that is driven, the points of its path, and when the drive began."""
        node = runtime.node
        self._poses = node.create_publisher(PoseStamped, names.POSE, 10)
        self._odometry = node.create_publisher(Odometry, names.ODOM, 10)
        self._localized = node.create_publisher(PoseWithCovarianceStamped, names.AMCL_POSE, names.transient_local_qos())
        self._plans = node.create_publisher(Path, names.PLAN, 10)
        self._map = node.create_publisher(OccupancyGrid, names.MAP, names.transient_local_qos())
        self._map.publish(grid_message(map, 'map', node.get_clock().now().to_msg()))
        self._servers: dict[str, tuple[Any, GoalServer]] = {}
        self._fault_ends: dict[str, Timer] = {}
        self._serve(names.COMPUTE_PATH_TO_POSE, ComputePathToPose, self._plan)
        self._serve(names.COMPUTE_PATH_THROUGH_POSES, ComputePathThroughPoses, self._plan)
        self._serve(names.SMOOTH_PATH, SmoothPath, self._smooth)
        self._serve(names.FOLLOW_PATH, FollowPath, self._follow)
        self._serve(names.WAIT, Wait, lambda goal, result: self._end_in(seconds_of(goal.request.time), goal, result))
        for name, kind in _TASKS.items():
            self._serve(name, kind, partial(self._end_in, _TASK_SECONDS))
        for name in (names.CLEAR_GLOBAL_COSTMAP, names.CLEAR_LOCAL_COSTMAP):
            node.create_service(ClearEntireCostmap, name, lambda _request, response: response)
        node.create_service(SetFault, f'{names.SIMULATOR}/set_fault', self._set_fault)
        self._amcl = LifecycleSubnode(runtime, names.AMCL)  # programs wait until it is active
        self._tell_again()
        LivelinessWatch(runtime, names.BT_SERVER, lambda is_alive: None if is_alive else self._end_all())
        runtime.health.on_hang(lambda hang: runtime.post(self._end_all) if hang.was_out_of_reach else None)
        LivelinessToken(runtime).set_ready(True)

    def _serve(self, name: str, kind: Any, begin: Callable[[ServedGoal, Any], None]) -> None:
        """Serve an action: ``begin`` gets each goal, and the result with which it may succeed."""

        def cancel(goal: ServedGoal) -> None:
            self._halt(goal)
            goal.canceled(kind.Result())

        server = GoalServer(self._runtime, kind, name, lambda goal: begin(goal, kind.Result()), cancel)
        self._servers[name] = kind, server

    def _end_all(self) -> None:
        """End all goals, as navigation does: their owner is gone, or may have gone while this process was stopped."""
        for _, server in self._servers.values():
            server.end_all(ServedGoal.abort)

    def _end_in(self, seconds: float, goal: ServedGoal, result: Any) -> None:
        self._runtime.post_in(seconds, lambda: goal.succeed(result))

    def _plan(self, goal: ServedGoal, result: Any) -> None:
        goals = [goal.request.goal] if hasattr(goal.request, 'goal') else goal.request.goals
        result.path.header.frame_id = 'map'
        result.path.poses = [stamped(self._now(), 'map', Time()), *getattr(goals, 'goals', goals)]
        self._plans.publish(result.path)
        self._end_in(_PLAN_SECONDS, goal, result)

    def _smooth(self, goal: ServedGoal, result: Any) -> None:
        result.path, result.was_completed = goal.request.path, True
        self._end_in(_PLAN_SECONDS, goal, result)

    def _follow(self, goal: ServedGoal, result: Any) -> None:
        if self._drive is not None:
            self._drive[0].abort(FollowPath.Result())
            self._halt(self._drive[0])
        points = [self._pose, *_joined(self._pose, [pose_of(one.pose) for one in goal.request.path.poses])]
        self._drive = goal, points, self._runtime.steady.now()

        def arrive() -> None:
            if goal.active:
                self._halt(goal)
                goal.succeed(result)

        goal.on_cancel(lambda: self._halt(goal))
        self._runtime.post_in(_length(points) / self._speed, arrive)

    def _halt(self, goal: ServedGoal) -> None:
        if self._drive is not None and goal is self._drive[0]:
            self._pose, self._drive = self._now(), None
            self._tell_pose()
            self._runtime.post_in(_REST_SECONDS, self._tell_rest)

    def _tell_rest(self) -> None:
        if self._drive is None:
            self._tell_pose()

    def _now(self) -> Pose:
        """Return the pose at this moment."""
        if self._drive is None:
            return self._pose
        _, points, began = self._drive
        driven = self._speed * (self._runtime.steady.now() - began)
        ends = accumulate(a.distance(b) for a, b in pairwise(points))
        for (a, b), end in zip(pairwise(points), ends, strict=True):
            if driven < end:
                part = 1.0 - (end - driven) / a.distance(b)
                yaw = math.atan2(b.y - a.y, b.x - a.x)
                return Pose(a.x + part * (b.x - a.x), a.y + part * (b.y - a.y), yaw)
        return points[-1]

    def _tell_again(self) -> None:
        self._tell_pose()
        self._runtime.post_in(_POSE_SECONDS, self._tell_again)

    def _tell_pose(self) -> None:
        message = stamped(self._now(), 'map', self._runtime.node.get_clock().now().to_msg())
        self._poses.publish(message)
        localized = PoseWithCovarianceStamped(header=message.header)
        localized.pose.pose = message.pose
        self._localized.publish(localized)
        odometry = Odometry(header=message.header)
        odometry.twist.twist.linear.x = self._speed if self._drive else 0.0
        self._odometry.publish(odometry)
        if self._drive is not None and self._drive[0].active:
            goal, points, began = self._drive
            left = max(0.0, _length(points) - self._speed * (self._runtime.steady.now() - began))
            goal.publish_feedback(FollowPath.Feedback(distance_to_goal=left, speed=self._speed))

    def _set_fault(self, request: Any, response: Any) -> Any:
        """Let a server abort its goals, as ``server_fails`` of the simulator does; it has no other fault."""
        if request.clear:
            for _, server in self._servers.values():
                server.fault = GoalFault()
            response.success = True
            return response
        given = yaml.safe_load(request.parameters) or {}
        name = str(given.get('server', names.FOLLOW_PATH))
        if request.fault != 'server_fails' or name not in self._servers:
            response.message = f'an abstract robot has only the fault server_fails, of {", ".join(self._servers)}'
            return response
        if not all(0.0 <= seconds < math.inf for seconds in (request.after, request.duration)):
            response.message = f'after {request.after:g} s for {request.duration:g} s; give times that are not negative'
            return response
        kind, server = self._servers[name]
        result = kind.Result()
        for field in ('error_code', 'error_msg'):
            if field in given and hasattr(result, field):
                setattr(result, field, given[field])

        def begin() -> None:
            if self._drive is not None and name == names.FOLLOW_PATH:
                self._halt(self._drive[0])
            server.fault = GoalFault(failure=result)
            if earlier := self._fault_ends.pop(name, None):
                earlier.cancel()
            if request.duration:
                end = partial(setattr, server, 'fault', GoalFault())
                self._fault_ends[name] = self._runtime.post_in(request.duration, end)

        if request.after:
            self._runtime.post_in(request.after, begin)
        else:
            begin()
        response.success = True
        return response


def _joined(pose: Pose, path: list[Pose]) -> list[Pose]:
    """Return a path from where the robot is beside its first leg: what it has driven while it was planned is behind."""
    if len(path) < 2:
        return path
    a, b = path[:2]
    square = a.distance(b) ** 2
    part = ((pose.x - a.x) * (b.x - a.x) + (pose.y - a.y) * (b.y - a.y)) / square if square else 1.0
    part = min(max(part, 0.0), 1.0)
    return [Pose(a.x + part * (b.x - a.x), a.y + part * (b.y - a.y), a.yaw), *path[1:]]


def _length(points: list[Pose]) -> float:
    return sum(a.distance(b) for a, b in pairwise(points))


def run(kind: Callable[..., AbstractRobot], **how: Any) -> int:
    """Run the node of a robot that ``kind`` makes, as the main function of a process. Return its exit code."""
    arguments = SCHEDULER.current.process.arguments
    return run_node(names.NAVIGATION, lambda runtime: runtime.call(partial(kind, runtime, **how)), arguments)
