# SPDX-License-Identifier: BSD-3-Clause
"""The parameters that all navigation servers share: frames, topics and times of the robot."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

from flexbt_common import names
from flexbt_common.runtime.parameters import ALLOWED_DIRECTORIES_TEXT, ParameterDeclarer


@dataclass(frozen=True)
class RobotParameters:
    """Values of the parameters; see :func:`declare_robot_parameters` for meaning and unit."""

    map_frame: str
    transform_tolerance: float
    pose_topic: str
    map_topic: str
    base_frame: str
    cmd_vel_topic: str
    stamped_cmd_vel: bool
    pose_timeout: float
    allowed_directories: tuple[Path, ...]


def declare_robot_parameters(declare: ParameterDeclarer, files: Iterable[str]) -> RobotParameters:
    """Declare the parameters and read them. The directories of ``files`` are allowed, too.

    Raises:
        UnfitParameterError: a value that cannot work.
    """
    return RobotParameters(
        map_frame=declare.text('global_frame', 'map', 'frame of map, poses and paths'),
        transform_tolerance=declare.real(
            'transform_tolerance', 0.3, 0.0, 10.0, 'how long the transform of a request is waited for, s of wall time'
        ),
        pose_topic=declare.text('pose_topic', names.POSE, "topic of the robot's pose, geometry_msgs/PoseStamped"),
        map_topic=declare.text('map_topic', names.MAP, 'topic of the map'),
        base_frame=declare.text('robot_base_frame', 'base_link', 'frame of the robot, in which the lidar is mounted'),
        cmd_vel_topic=declare.text('cmd_vel_topic', names.CMD_VEL, 'topic of the velocity commands'),
        stamped_cmd_vel=declare.flag('enable_stamped_cmd_vel', False, 'commands are TwistStamped instead of Twist'),
        pose_timeout=declare.real(
            'pose_timeout',
            1.0,
            0.1,
            60.0,
            'time without a pose after which motions fail, s; a pause of simulated time does not count',
        ),
        allowed_directories=(
            *declare.directories('allowed_directories', (), ALLOWED_DIRECTORIES_TEXT),
            *(Path(file).absolute().parent for file in files if file),
        ),
    )
