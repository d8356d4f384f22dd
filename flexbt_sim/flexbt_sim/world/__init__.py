# SPDX-License-Identifier: BSD-3-Clause
"""The simulated world: maps, robots, sensors. Pure."""

from .geometry import FARTHEST, Pose, drive, wrap
from .lidar import Lidar, LidarModel
from .occupancy_map import (
    FAR,
    FREE,
    MAX_CELLS,
    MAX_RESOLUTION,
    MIN_RESOLUTION,
    OCCUPIED,
    UNKNOWN,
    OccupancyMap,
    load_map,
)
from .pacing import ANSWER_SECONDS, IDLE_FACTOR, MAX_LAG, Pacer, Schedule
from .placement import check_place
from .robot import COLLISION_CHECK_DISTANCE, TICK, Robot, RobotLimits

__all__ = [
    'ANSWER_SECONDS',
    'COLLISION_CHECK_DISTANCE',
    'FAR',
    'FARTHEST',
    'FREE',
    'IDLE_FACTOR',
    'MAX_CELLS',
    'MAX_LAG',
    'MAX_RESOLUTION',
    'MIN_RESOLUTION',
    'OCCUPIED',
    'TICK',
    'UNKNOWN',
    'Lidar',
    'LidarModel',
    'OccupancyMap',
    'Pacer',
    'Pose',
    'Robot',
    'RobotLimits',
    'Schedule',
    'check_place',
    'drive',
    'load_map',
    'wrap',
]
