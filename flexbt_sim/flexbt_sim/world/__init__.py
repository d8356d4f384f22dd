# SPDX-License-Identifier: BSD-3-Clause
"""The simulated world: maps, robots and what is round them, sensors, faults, time. Pure.

``World.load(file)`` reads a world file, ``step`` lets time pass.
"""

from flexbt_sim.world.device import Device, Sensor
from flexbt_sim.world.devices import (
    Battery,
    BatteryModel,
    Bumper,
    Gripper,
    GripperModel,
    Imu,
    ImuModel,
    Lidar,
    LidarModel,
    RangeFinder,
    RangeFinderModel,
    Scan,
)
from flexbt_sim.world.faults import FAULTS, Fault
from flexbt_sim.world.models import (
    MODELS,
    DoorModel,
    DriveModel,
    ObstacleModel,
    OdometryModel,
    RobotModel,
    RouteModel,
    StationModel,
    WalkModel,
    ZoneModel,
)
from flexbt_sim.world.plane.geometry import (
    FARTHEST,
    Circle,
    Point,
    Polygon,
    Pose,
    Shape,
    box,
    compose,
    drive,
    gap,
    inverse,
    wrap,
)
from flexbt_sim.world.plane.occupancy_map import FREE, OCCUPIED, UNKNOWN, OccupancyMap, load_map
from flexbt_sim.world.plane.space import Body
from flexbt_sim.world.specification import FaultModel
from flexbt_sim.world.world_file import WorldFile

from .pictures import Trace, TraceFrame, draw_world
from .robot import COMMAND_PERIOD, Robot
from .scenery import Door, Entity, Obstacle, Station, Zone
from .world import EntityModel, EntityState, World, WorldSnapshot

__all__ = [
    'COMMAND_PERIOD',
    'FARTHEST',
    'FAULTS',
    'FREE',
    'MODELS',
    'OCCUPIED',
    'UNKNOWN',
    'Battery',
    'BatteryModel',
    'Body',
    'Bumper',
    'Circle',
    'Device',
    'Door',
    'DoorModel',
    'DriveModel',
    'Entity',
    'EntityModel',
    'EntityState',
    'Fault',
    'FaultModel',
    'Gripper',
    'GripperModel',
    'Imu',
    'ImuModel',
    'Lidar',
    'LidarModel',
    'Obstacle',
    'ObstacleModel',
    'OccupancyMap',
    'OdometryModel',
    'Point',
    'Polygon',
    'Pose',
    'RangeFinder',
    'RangeFinderModel',
    'Robot',
    'RobotModel',
    'RouteModel',
    'Scan',
    'Sensor',
    'Shape',
    'Station',
    'StationModel',
    'Trace',
    'TraceFrame',
    'WalkModel',
    'World',
    'WorldFile',
    'WorldSnapshot',
    'Zone',
    'ZoneModel',
    'box',
    'compose',
    'draw_world',
    'drive',
    'gap',
    'inverse',
    'load_map',
    'wrap',
]
