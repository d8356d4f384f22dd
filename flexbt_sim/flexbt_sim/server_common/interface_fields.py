# SPDX-License-Identifier: BSD-3-Clause
"""Fields of Nav2's interfaces that differ between its branches jazzy and main: by what the installed ones have."""

from __future__ import annotations

from typing import Any

from builtin_interfaces.msg import Time
from nav2_msgs.action import FollowPath

from flexbt_sim.navigation import PathFollower
from flexbt_sim.ros_messages import stamped
from flexbt_sim.world import Pose


def set_success(response: Any) -> None:
    """Say that it was done; the costmaps' services of jazzy have no words for it."""
    if hasattr(response, 'success'):
        response.success = True


def following(motion: PathFollower, pose: Pose, frame: str, stamp: Time) -> FollowPath.Feedback:
    """How the robot, at ``pose`` in ``frame``, follows its path; in main with all of nav2_msgs/TrackingFeedback."""
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
