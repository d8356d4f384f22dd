# SPDX-License-Identifier: BSD-3-Clause
"""What the navigation servers share: parameters, robot, costmaps, frames, request checks, ends of goals, motions."""

from .action_results import CANCELED, SUCCEEDED, GoalEnd, OnPathEnd, end_by, finish
from .computation import Computation
from .frames import Asked, OnError, asked_path, asked_pose
from .interface_fields import following, set_success
from .motion_server import MotionArbiter, MotionServer, RunningMotion
from .navigation_parameters import NavigationParameters, declare_navigation_parameters
from .request_checks import bounded, check_id
from .robot_interface import PoseWatch, RobotInterface
from .route_parameters import ADJUST_SPEED_LIMIT, COLLISION_MONITOR, DYNAMIC_EDGES, REROUTING_SERVICE, TIME_MARKER

__all__ = [
    'ADJUST_SPEED_LIMIT',
    'CANCELED',
    'COLLISION_MONITOR',
    'DYNAMIC_EDGES',
    'REROUTING_SERVICE',
    'SUCCEEDED',
    'TIME_MARKER',
    'Asked',
    'Computation',
    'GoalEnd',
    'MotionArbiter',
    'MotionServer',
    'NavigationParameters',
    'OnError',
    'OnPathEnd',
    'PoseWatch',
    'RobotInterface',
    'RunningMotion',
    'asked_path',
    'asked_pose',
    'bounded',
    'check_id',
    'declare_navigation_parameters',
    'end_by',
    'finish',
    'following',
    'set_success',
]
