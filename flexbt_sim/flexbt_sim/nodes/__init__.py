# SPDX-License-Identifier: BSD-3-Clause
"""The nodes around world and navigation: ``simulator`` and ``navigation``, and how their values become messages."""

from .motion_server import MotionArbiter
from .navigation_parameters import declare_navigation_parameters
from .navigation_servers import Navigation
from .ros_messages import grid_message, map_of, pose_of, seconds_of, time_message
from .simulator import Simulator
from .simulator_parameters import built_in_map, declare_simulator_parameters

__all__ = [
    'MotionArbiter',
    'Navigation',
    'Simulator',
    'built_in_map',
    'declare_navigation_parameters',
    'declare_simulator_parameters',
    'grid_message',
    'map_of',
    'pose_of',
    'seconds_of',
    'time_message',
]
