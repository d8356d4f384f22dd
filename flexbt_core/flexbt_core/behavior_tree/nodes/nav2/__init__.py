# SPDX-License-Identifier: BSD-3-Clause
"""The node types of Nav2 that need no ROS."""

from .dialects import DIALECTS, Dialect, register_dialects
from .motion import DistanceController, Position, SpeedController
from .pause_resume import PauseResumeController
from .register import register_nav2

__all__ = [
    'DIALECTS',
    'Dialect',
    'DistanceController',
    'PauseResumeController',
    'Position',
    'SpeedController',
    'register_dialects',
    'register_nav2',
]
