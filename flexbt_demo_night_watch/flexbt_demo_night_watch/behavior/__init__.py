# SPDX-License-Identifier: BSD-3-Clause
"""The behavior of a robot on night watch, and its own states."""

from .compare_scan_state import CompareScanState, unexpected_points
from .next_room_state import ROOMS_LEFT, NextRoomState, rooms_left
from .night_watch import NightWatch
from .open_door_state import OpenDoorState
from .watch_partner_state import WatchPartnerState

__all__ = [
    'ROOMS_LEFT',
    'CompareScanState',
    'NextRoomState',
    'NightWatch',
    'OpenDoorState',
    'WatchPartnerState',
    'rooms_left',
    'unexpected_points',
]
