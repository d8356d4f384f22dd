# SPDX-License-Identifier: BSD-3-Clause
"""The simulated world: maps, robots and what is round them, sensors, faults, time. Pure.

``World.load(file)`` reads a world file, ``step`` lets time pass.
"""

from .bodies import Body, generator
from .faults import FAULTS, Fault, FaultModel, MessagesDropped, MessagesLate, fault_parameters
from .geometry import FARTHEST, Pose, drive, wrap
from .lidar import Lidar
from .map_robot import COLLISION_CHECK_DISTANCE, TICK, MapRobot, RobotLimits
from .models import (
    MODELS,
    BatteryModel,
    DoorModel,
    DriveModel,
    LidarModel,
    ObstacleModel,
    OdometryModel,
    RobotModel,
    RouteModel,
    StationModel,
    WalkModel,
    ZoneModel,
)
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
from .pacing import ANSWER_SECONDS, COMPUTING_FACTOR, IDLE_FACTOR, MAX_LAG, Drivers, Pacer, Schedule
from .pictures import Frame, Trace, draw_world
from .placement import check_place
from .ray_casting import RayCaster, Sensor, outlines
from .robot import Battery, Robot, Scan, compose, inverse
from .scenery import Door, Entity, Obstacle, Station, Zone
from .shapes import Circle, Polygon, Shape, box, gap
from .specification import NAME
from .world import EntityModel, EntityState, Snapshot, World
from .world_file import WorldFile

__all__ = [
    'ANSWER_SECONDS',
    'COLLISION_CHECK_DISTANCE',
    'COMPUTING_FACTOR',
    'FAR',
    'FARTHEST',
    'FAULTS',
    'FREE',
    'IDLE_FACTOR',
    'MAX_CELLS',
    'MAX_LAG',
    'MAX_RESOLUTION',
    'MIN_RESOLUTION',
    'MODELS',
    'NAME',
    'OCCUPIED',
    'TICK',
    'UNKNOWN',
    'Battery',
    'BatteryModel',
    'Body',
    'Circle',
    'Door',
    'DoorModel',
    'DriveModel',
    'Drivers',
    'Entity',
    'EntityModel',
    'EntityState',
    'Fault',
    'FaultModel',
    'Frame',
    'Lidar',
    'LidarModel',
    'MapRobot',
    'MessagesDropped',
    'MessagesLate',
    'Obstacle',
    'ObstacleModel',
    'OccupancyMap',
    'OdometryModel',
    'Pacer',
    'Polygon',
    'Pose',
    'RayCaster',
    'Robot',
    'RobotLimits',
    'RobotModel',
    'RouteModel',
    'Scan',
    'Schedule',
    'Sensor',
    'Shape',
    'Snapshot',
    'Station',
    'StationModel',
    'Trace',
    'WalkModel',
    'World',
    'WorldFile',
    'Zone',
    'ZoneModel',
    'box',
    'check_place',
    'compose',
    'draw_world',
    'drive',
    'fault_parameters',
    'gap',
    'generator',
    'inverse',
    'load_map',
    'outlines',
    'wrap',
]
