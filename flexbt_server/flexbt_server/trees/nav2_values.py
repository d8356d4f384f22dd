# SPDX-License-Identifier: BSD-3-Clause
"""Messages that only the branch main of Nav2 has: plain values of the same fields where the interfaces lack them."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, Final

import nav2_msgs.msg
from geometry_msgs.msg import PoseStamped
from std_msgs.msg import Header


@dataclass
class _TrackingFeedback:
    """How the robot is on its path; lengths in m, the speed in m/s."""

    header: Header = field(default_factory=Header)
    position_tracking_error: float = 0.0
    """Distance from the path, m; positive to the left of it."""
    heading_tracking_error: float = 0.0
    """Angle from the direction of the path to that of the robot, rad, -pi to pi."""
    current_path_index: int = 0
    robot_pose: PoseStamped = field(default_factory=PoseStamped)
    distance_to_goal: float = 0.0
    speed: float = 0.0
    remaining_path_length: float = 0.0


@dataclass
class _WaypointStatus:
    """What became of a waypoint."""

    waypoint_status: int = 0
    waypoint_index: int = 0
    waypoint_pose: PoseStamped = field(default_factory=PoseStamped)
    error_code: int = 0
    error_msg: str = ''


TrackingFeedback: Final[Any] = getattr(nav2_msgs.msg, 'TrackingFeedback', _TrackingFeedback)
WaypointStatus: Final[Any] = getattr(nav2_msgs.msg, 'WaypointStatus', _WaypointStatus)
