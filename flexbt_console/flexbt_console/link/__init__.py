# SPDX-License-Identifier: BSD-3-Clause
"""The console's side of the operator link: messages of ROS to the records of the mirror, and commands to messages.

The one place of the console where ROS is spoken.
"""

from .fleet_link import FleetLink
from .interface_check import interface_problem
from .messages import (
    behaviors_record,
    command_message,
    event_records,
    guard_record,
    log_record,
    places_record,
    snapshot_record,
    structure_record,
    subjects_record,
)
from .operator_link import OperatorLink
from .scan_link import MESSAGE_BYTES as SCAN_BYTES
from .scan_link import PLACE_SECONDS, SCAN_SECONDS, points_of
from .simulator_link import SimulatorLink
from .surroundings_link import SurroundingsFeed, SurroundingsLink

__all__ = [
    'PLACE_SECONDS',
    'SCAN_BYTES',
    'SCAN_SECONDS',
    'FleetLink',
    'OperatorLink',
    'SimulatorLink',
    'SurroundingsFeed',
    'SurroundingsLink',
    'behaviors_record',
    'command_message',
    'event_records',
    'guard_record',
    'interface_problem',
    'log_record',
    'places_record',
    'points_of',
    'snapshot_record',
    'structure_record',
    'subjects_record',
]
