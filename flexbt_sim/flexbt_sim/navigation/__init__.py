# SPDX-License-Identifier: BSD-3-Clause
"""Planning and control. Pure."""

from .behaviors import ROLL_TIME, AssistedTeleop, DriveMotion, SpinMotion
from .collision_monitor import slowed
from .costmap import INSCRIBED, LETHAL, Box, Costmap, Inflation
from .hybrid_planner import HybridPlanner, planner_for
from .layers import LayeredCostmap, Observation, ObstacleRanges, local_size
from .motions import LOOK_AHEAD, STOP, Motion, Steering, TurnLimits, Velocity, collides
from .navigator import Navigator, Trip
from .path_follower import STILL, FollowerLimits, PathFollower, ProgressChecker
from .planner import END_TOLERANCE, SPACING, GridPlanner, PlanningStopped, StopFlag
from .preparation import prepare_navigation
from .smoother import Smoothing, smooth_path
from .track import Track

__all__ = [
    'END_TOLERANCE',
    'INSCRIBED',
    'LETHAL',
    'LOOK_AHEAD',
    'ROLL_TIME',
    'SPACING',
    'STILL',
    'STOP',
    'AssistedTeleop',
    'Box',
    'Costmap',
    'DriveMotion',
    'FollowerLimits',
    'GridPlanner',
    'HybridPlanner',
    'Inflation',
    'LayeredCostmap',
    'Motion',
    'Navigator',
    'Observation',
    'ObstacleRanges',
    'PathFollower',
    'PlanningStopped',
    'ProgressChecker',
    'Smoothing',
    'SpinMotion',
    'Steering',
    'StopFlag',
    'Track',
    'Trip',
    'TurnLimits',
    'Velocity',
    'collides',
    'local_size',
    'planner_for',
    'prepare_navigation',
    'slowed',
    'smooth_path',
]
