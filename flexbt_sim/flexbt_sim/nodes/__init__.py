# SPDX-License-Identifier: BSD-3-Clause
"""The node ``navigation`` with its servers, and how values become messages."""

from .motion_server import MotionArbiter
from .navigation_parameters import declare_navigation_parameters
from .navigation_servers import Navigation
from .ros_messages import grid_message, map_of, pose_message, pose_of, seconds_of, time_message, transform

__all__ = [
    'MotionArbiter',
    'Navigation',
    'declare_navigation_parameters',
    'grid_message',
    'map_of',
    'pose_message',
    'pose_of',
    'seconds_of',
    'time_message',
    'transform',
]
