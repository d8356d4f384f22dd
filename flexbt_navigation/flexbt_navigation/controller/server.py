# SPDX-License-Identifier: BSD-3-Clause
"""The action follow_path, the topic that limits the speed, and the parameters of the controller with Nav2's names."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any

from builtin_interfaces.msg import Time
from nav2_msgs.action import FollowPath
from nav2_msgs.msg import SpeedLimit

from flexbt_common import names
from flexbt_common.middleware.received_messages import COMPLAINT_SECONDS
from flexbt_common.runtime.node_runtime import NodeRuntime
from flexbt_core.values.parameter_fields import parameter
from flexbt_navigation.common.requests import asked_path, check_id
from flexbt_sim.messages import stamped
from flexbt_sim.world.plane.geometry import Pose

from .motion_server import MotionArbiter, MotionServer
from .path_follower import FollowerLimits, PathFollower


@dataclass
class ControllerParameters:
    """Parameters of the controller.

    While the servers run, ``follower`` may be set to another one, for the goals that come then. On the executor thread.
    """

    controller_ids: tuple[str, ...] = parameter(
        'controller_ids', ('FollowPath',), 'names under which the controller is known'
    )
    goal_checker_ids: tuple[str, ...] = parameter(
        'goal_checker_ids', ('general_goal_checker', 'goal_checker'), 'names under which the goal checker is known'
    )
    progress_checker_ids: tuple[str, ...] = parameter(
        'progress_checker_ids', ('progress_checker',), 'names under which the progress checker is known'
    )
    follower: FollowerLimits = field(default_factory=FollowerLimits)


class ControllerServer:
    """On the executor thread."""

    def __init__(self, runtime: NodeRuntime, parameters: ControllerParameters, arbiter: MotionArbiter) -> None:
        self._runtime = runtime
        self._parameters = parameters
        self._arbiter = arbiter
        self._speed_limit = math.inf
        MotionServer(
            runtime,
            arbiter,
            FollowPath,
            names.FOLLOW_PATH,
            self._follow,
            self._feedback,
            lambda request: asked_path(request.path),
        )
        runtime.node.create_subscription(SpeedLimit, names.SPEED_LIMIT, self._limit_speed, 10)

    def _follow(self, request: Any, *path: Pose) -> PathFollower:
        parameters, robot = self._parameters, self._arbiter.robot
        check_id(request.controller_id, parameters.controller_ids, 'controller', 'INVALID_CONTROLLER')
        check_id(request.goal_checker_id, parameters.goal_checker_ids, 'goal checker', 'UNKNOWN')
        check_id(request.progress_checker_id, parameters.progress_checker_ids, 'progress checker', 'UNKNOWN')
        running = self._arbiter.running
        before = running.motion if running is not None and isinstance(running.motion, PathFollower) else None
        drift = robot.map_frame.drift(request.path.header)
        follower = PathFollower(path, robot.costmaps.local, parameters.follower, before, drift)
        follower.speed_limit = self._speed_limit
        return follower

    def _limit_speed(self, message: SpeedLimit) -> None:
        """Set a speed limit as Nav2's controller server does: percent of the desired speed, or m/s; 0 for none."""
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

    def _feedback(self, motion: PathFollower) -> FollowPath.Feedback:
        robot = self._arbiter.robot
        return following(motion, robot.pose, robot.parameters.map_frame, self._runtime.clock.stamp())


def following(motion: PathFollower, pose: Pose, frame: str, stamp: Time) -> FollowPath.Feedback:
    """Return how the robot, at ``pose`` in ``frame``, follows its path; in main with all of
    nav2_msgs/TrackingFeedback."""
    feedback = FollowPath.Feedback()
    if not hasattr(feedback, 'tracking_feedback'):
        feedback.distance_to_goal, feedback.speed = float(motion.distance_to_goal), float(motion.speed)
        return feedback
    told, place = feedback.tracking_feedback, motion.place(pose)
    told.robot_pose = stamped(pose, frame, stamp)
    told.header = told.robot_pose.header
    told.position_tracking_error, told.heading_tracking_error = place.left, place.turned
    told.current_path_index, told.distance_to_goal = place.passed, place.to_goal
    told.remaining_path_length, told.speed = float(motion.distance_to_goal), float(motion.speed)
    return feedback
