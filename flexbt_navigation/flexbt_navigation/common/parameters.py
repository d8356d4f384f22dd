# SPDX-License-Identifier: BSD-3-Clause
"""The parameters that all navigation servers share: frames, topics and times of the robot."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from flexbt_common import names
from flexbt_core.values.parameter_fields import parameter


@dataclass(frozen=True)
class RobotParameters:
    """Parameters of the robot. Services load files from the ``allowed_directories``."""

    map_frame: str = parameter('global_frame', 'map', 'frame of map, poses and paths')
    transform_tolerance: float = parameter(
        'transform_tolerance', 0.3, 'how long the transform of a request is waited for, s of wall time', 0.0, 10.0
    )
    pose_topic: str = parameter('pose_topic', names.POSE, "topic of the robot's pose, geometry_msgs/PoseStamped")
    map_topic: str = parameter('map_topic', names.MAP, 'topic of the map')
    base_frame: str = parameter('robot_base_frame', 'base_link', 'frame of the robot, in which the lidar is mounted')
    cmd_vel_topic: str = parameter('cmd_vel_topic', names.CMD_VEL, 'topic of the velocity commands')
    stamped_cmd_vel: bool = parameter('enable_stamped_cmd_vel', False, 'commands are TwistStamped instead of Twist')
    pose_timeout: float = parameter(
        'pose_timeout',
        1.0,
        'time without a pose after which motions fail, s; a pause of simulated time does not count',
        0.1,
        60.0,
    )
    allowed_directories: tuple[Path, ...] = ()
