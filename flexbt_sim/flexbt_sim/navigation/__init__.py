# SPDX-License-Identifier: BSD-3-Clause
"""Planning and control. Pure."""

from .behaviors import ROLL_TIME, AssistedTeleop, DriveMotion, SpinMotion
from .collision_monitor import slowed
from .hybrid_planner import HybridPlanner, planner_for
from .motions import LOOK_AHEAD, STOP, Inertia, KeepingApart, Motion, Steering, TurnLimits, Velocity, collides
from .navigator import Navigator, Trip
from .path_follower import STILL, FollowerLimits, PathFollower, ProgressChecker
from .planner import END_TOLERANCE, SPACING, GridPlanner, PlanningStopped, StopFlag
from .preparation import prepare_navigation
from .smoother import Smoothing, smooth_path
from .track import Track

__all__ = [
    'END_TOLERANCE',
    'LOOK_AHEAD',
    'ROLL_TIME',
    'SPACING',
    'STILL',
    'STOP',
    'AssistedTeleop',
    'DriveMotion',
    'FollowerLimits',
    'GridPlanner',
    'HybridPlanner',
    'Inertia',
    'KeepingApart',
    'Motion',
    'Navigator',
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
    'planner_for',
    'prepare_navigation',
    'slowed',
    'smooth_path',
]
