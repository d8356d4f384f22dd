# SPDX-License-Identifier: BSD-3-Clause
"""What operators and programs see of the executive, and its own way to stop the robot."""

from .command_intake import CommandIntake
from .event_stream import EventStream
from .executive_status import status_of, subjects_of
from .motion_stop import MOTION_ACTIONS, MotionStop
from .operator_link import OperatorLink
from .peers import PeersWatch
from .robot_plan import RobotPlan
from .robot_pose import RobotPose
from .shown_status import Picture, ShownStatus
from .status_publisher import BURST, MAXIMUM_RATE, StatusPublisher
from .userdata_server import UserdataServer

__all__ = [
    'BURST',
    'MAXIMUM_RATE',
    'MOTION_ACTIONS',
    'CommandIntake',
    'EventStream',
    'MotionStop',
    'OperatorLink',
    'PeersWatch',
    'Picture',
    'RobotPlan',
    'RobotPose',
    'ShownStatus',
    'StatusPublisher',
    'UserdataServer',
    'status_of',
    'subjects_of',
]
