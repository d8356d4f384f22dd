# SPDX-License-Identifier: BSD-3-Clause
"""The simulated world: maps, robots and what is round them, sensors, faults, time. Pure.

``World.load(file)`` reads a world file, ``step`` lets time pass.
"""

from flexbt_sim.world.descriptions.faults import (
    FAULTS,
    NAVIGATION_SERVERS,
    TOPICS,
    Fault,
    MessagesDropped,
    MessagesLate,
    ServerDies,
    ServerFails,
    ServerFault,
    ServerHangs,
    ServerRefuses,
    fault_parameters,
)
from flexbt_sim.world.descriptions.models import (
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
from flexbt_sim.world.descriptions.world_file import WorldFile
from flexbt_sim.world.devices.battery import Battery, BatteryModel
from flexbt_sim.world.devices.device import Device, Sensor
from flexbt_sim.world.devices.imu import Imu, ImuModel
from flexbt_sim.world.devices.lidar import Lidar, LidarModel, Scan
from flexbt_sim.world.devices.range_finder import RangeFinder, RangeFinderModel
from flexbt_sim.world.devices.touch import Bumper, Gripper, GripperModel
from flexbt_sim.world.plane.bodies import Body, generator
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
from flexbt_sim.world.plane.occupancy_map import (
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
from flexbt_sim.world.plane.ray_casting import Beams, RayCaster, outlines
from flexbt_sim.world.specification import NAME, FaultModel

from .pacing import ANSWER_SECONDS, COMPUTING_FACTOR, IDLE_FACTOR, MAX_LAG, STALL_SECONDS, Drivers, Pacer, Schedule
from .pictures import Trace, TraceFrame, draw_world
from .robot import COMMAND_PERIOD, Robot
from .scenery import Door, Entity, Obstacle, Station, Zone
from .world import EntityModel, EntityState, World, WorldSnapshot, prepare_world

__all__ = [
    'ANSWER_SECONDS',
    'COMMAND_PERIOD',
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
    'NAVIGATION_SERVERS',
    'OCCUPIED',
    'STALL_SECONDS',
    'TOPICS',
    'UNKNOWN',
    'Battery',
    'BatteryModel',
    'Beams',
    'Body',
    'Bumper',
    'Circle',
    'Device',
    'Door',
    'DoorModel',
    'DriveModel',
    'Drivers',
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
    'MessagesDropped',
    'MessagesLate',
    'Obstacle',
    'ObstacleModel',
    'OccupancyMap',
    'OdometryModel',
    'Pacer',
    'Point',
    'Polygon',
    'Pose',
    'RangeFinder',
    'RangeFinderModel',
    'RayCaster',
    'Robot',
    'RobotModel',
    'RouteModel',
    'Scan',
    'Schedule',
    'Sensor',
    'ServerDies',
    'ServerFails',
    'ServerFault',
    'ServerHangs',
    'ServerRefuses',
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
    'fault_parameters',
    'gap',
    'generator',
    'inverse',
    'load_map',
    'outlines',
    'prepare_world',
    'wrap',
]
