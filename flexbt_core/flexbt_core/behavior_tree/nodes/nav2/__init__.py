# SPDX-License-Identifier: BSD-3-Clause
"""The node types of Nav2 that need no ROS."""

from .branches import NAV2_BRANCHES, Nav2Branch, register_branches
from .motion import DistanceController, Position, SpeedController
from .pause_resume import PauseResumeController
from .register import register_nav2

__all__ = [
    'NAV2_BRANCHES',
    'DistanceController',
    'Nav2Branch',
    'PauseResumeController',
    'Position',
    'SpeedController',
    'register_branches',
    'register_nav2',
]
