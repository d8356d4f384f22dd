# SPDX-License-Identifier: BSD-3-Clause
"""The trees and blackboards that the server holds."""

from .blackboards import NO_RECOVERIES, RECOVERIES_KEY, Blackboards, Value, entries_of, read_values, write_all
from .nav2_values import TrackingFeedback, WaypointStatus
from .ros_json import RosJsonTypes
from .ros_ports import (
    DURATION,
    PATH,
    POSE_STAMPED,
    POSES,
    ROUTE,
    TRACKING_FEEDBACK,
    WAYPOINT_STATUSES,
    message_type,
)
from .tree_memory import MOST_LOADED
from .tree_store import FileReport, FoundTree, TreeStore

__all__ = [
    'DURATION',
    'MOST_LOADED',
    'NO_RECOVERIES',
    'PATH',
    'POSES',
    'POSE_STAMPED',
    'RECOVERIES_KEY',
    'ROUTE',
    'TRACKING_FEEDBACK',
    'WAYPOINT_STATUSES',
    'Blackboards',
    'FileReport',
    'FoundTree',
    'RosJsonTypes',
    'TrackingFeedback',
    'TreeStore',
    'Value',
    'WaypointStatus',
    'entries_of',
    'message_type',
    'read_values',
    'write_all',
]
