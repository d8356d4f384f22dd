# SPDX-License-Identifier: BSD-3-Clause
"""Planning and control. Pure."""

from .behaviors import AssistedTeleop, DriveMotion, SpinMotion
from .costmap import INSCRIBED, LETHAL, Costmap, Inflation
from .motions import LOOK_AHEAD, STOP, Motion, Velocity, collides
from .path_follower import FollowerLimits, PathFollower, ProgressChecker
from .planner import END_TOLERANCE, SPACING, GridPlanner, PlanningStopped, StopFlag, prepare
from .smoother import Smoothing, smooth_path
from .track import Track

__all__ = [
    'END_TOLERANCE',
    'INSCRIBED',
    'LETHAL',
    'LOOK_AHEAD',
    'SPACING',
    'STOP',
    'AssistedTeleop',
    'Costmap',
    'DriveMotion',
    'FollowerLimits',
    'GridPlanner',
    'Inflation',
    'Motion',
    'PathFollower',
    'PlanningStopped',
    'ProgressChecker',
    'Smoothing',
    'SpinMotion',
    'StopFlag',
    'Track',
    'Velocity',
    'collides',
    'prepare',
    'smooth_path',
]
