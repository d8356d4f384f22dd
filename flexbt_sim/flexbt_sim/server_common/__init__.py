# SPDX-License-Identifier: BSD-3-Clause
"""What the navigation servers share: parameters, robot, costmaps, frames, request checks, ends of goals, motions."""

from .action_results import CANCELED, SUCCEEDED, GoalEnd, OnPathEnd, end_by, finish
from .computation import Computation
from .costmap_parameters import CostmapParameters, declare_costmap_parameters
from .docking_parameters import DockingParameters, declare_docking_parameters
from .frames import Asked, OnError, asked_path, asked_pose
from .interface_fields import set_success
from .motion_server import MotionArbiter, MotionServer, RunningMotion
from .request_checks import bounded, check_id
from .robot_interface import PoseWatch, RobotInterface
from .robot_parameters import RobotParameters, declare_robot_parameters
from .route_parameters import (
    ADJUST_SPEED_LIMIT,
    COLLISION_MONITOR,
    DYNAMIC_EDGES,
    REROUTING_SERVICE,
    TIME_MARKER,
    RouteParameters,
    declare_route_parameters,
)

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
    'CostmapParameters',
    'DockingParameters',
    'GoalEnd',
    'MotionArbiter',
    'MotionServer',
    'OnError',
    'OnPathEnd',
    'PoseWatch',
    'RobotInterface',
    'RobotParameters',
    'RouteParameters',
    'RunningMotion',
    'asked_path',
    'asked_pose',
    'bounded',
    'check_id',
    'declare_costmap_parameters',
    'declare_docking_parameters',
    'declare_robot_parameters',
    'declare_route_parameters',
    'end_by',
    'finish',
    'set_success',
]
