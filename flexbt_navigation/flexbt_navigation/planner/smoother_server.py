# SPDX-License-Identifier: BSD-3-Clause
"""The action smooth_path."""

from __future__ import annotations

import time
from collections.abc import Sequence
from typing import Any, Final

from nav2_msgs.action import SmoothPath
from nav_msgs.msg import Path

from flexbt_common import names
from flexbt_common.calls.goal_server import GoalServer, ServedGoal
from flexbt_common.runtime.node_runtime import NodeRuntime
from flexbt_common.values.message_fields import duration_message, seconds_of
from flexbt_navigation.common.goals import SUCCEEDED, Computation, GoalEnd, OnPathEnd, finish
from flexbt_navigation.common.requests import Asked, asked_path, check_id
from flexbt_navigation.costmaps.costmap import Costmap
from flexbt_navigation.errors import NavigationError
from flexbt_navigation.robot_interface import RobotInterface
from flexbt_sim.messages import pose_message
from flexbt_sim.world.plane.geometry import Pose

from .smoother import Smoothing, smooth_path

SMOOTHERS: Final = {'simple_smoother': Smoothing(2), 'route_smoother': Smoothing(5, keeps_reversals=False)}
"""Smoothers of Nav2's bringup. The second one is for routes, whose corners may be cut. Without a name the first is
used."""


class SmootherServer:
    """On the executor thread."""

    def __init__(self, runtime: NodeRuntime, robot: RobotInterface) -> None:
        self._robot = robot
        self._computation = Computation(runtime, 'the smoother')
        self._smoothed = runtime.node.create_publisher(Path, names.PLAN_SMOOTHED, 1)
        # A goal that is to be canceled ends when its path is smooth.
        GoalServer(runtime, SmoothPath, names.SMOOTH_PATH, self._serve)

    def _serve(self, goal: ServedGoal) -> None:
        began = time.monotonic()

        def on_end(end: GoalEnd, path: Path | None = None) -> None:
            spent = duration_message(time.monotonic() - began)
            result = SmoothPath.Result(path=path or Path(), smoothing_duration=spent, was_completed=path is not None)
            finish(goal, result, end)

        def asked(request: Any) -> list[Asked]:
            nonlocal began
            began = time.monotonic()
            check_id(request.smoother_id, tuple(SMOOTHERS), 'smoother', 'INVALID_SMOOTHER')
            return asked_path(request.path)

        def smooth(poses: list[Pose]) -> None:
            self._compute(goal, began, poses, on_end)

        self._robot.with_poses(goal, asked, smooth, on_end, 'the smoother')

    def _compute(self, goal: ServedGoal, began: float, poses: list[Pose], on_end: OnPathEnd) -> None:
        request = goal.request
        costmap = self._robot.costmaps.shared
        limit = seconds_of(request.max_smoothing_duration)

        def check_time() -> None:
            if goal.cancel_requested or time.monotonic() - began > limit:
                raise NavigationError('TIMEOUT', f'the path is not smooth after {limit:g} s')

        def on_result(smoothed: list[Pose]) -> None:
            path = _with_poses(request.path, smoothed, self._robot.parameters.map_frame)
            self._smoothed.publish(path)
            on_end(_checked(smoothed, costmap) if request.check_for_collisions else SUCCEEDED, path)

        smoothing = SMOOTHERS[request.smoother_id or next(iter(SMOOTHERS))]
        self._computation.run(goal, lambda: smooth_path(poses, costmap, smoothing, check_time), on_result, on_end)


def _checked(poses: Sequence[Pose], costmap: Costmap) -> GoalEnd:
    """Return the end of a goal whose path must not touch anything."""
    for pose in poses:
        if costmap.in_collision(pose):
            said = f'the path is in collision at ({pose.x:.2f}, {pose.y:.2f})'
            return GoalEnd(code='SMOOTHED_PATH_IN_COLLISION', message=said)
    return SUCCEEDED


def _with_poses(path: Path, poses: Sequence[Pose], frame: str) -> Path:
    """Return the message with other poses, in the frame of the map; stamps and heights stay."""
    path.header.frame_id = frame
    for stamped, pose in zip(path.poses, poses, strict=True):
        stamped.header.frame_id = frame
        height = stamped.pose.position.z
        stamped.pose = pose_message(pose)
        stamped.pose.position.z = height
    return path
