# SPDX-License-Identifier: BSD-3-Clause
"""Descriptions of robots and their surroundings in world files."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from typing import ClassVar, Final

from flexbt_sim.world.device import Device
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
)
from flexbt_sim.world.plane.geometry import ORIGIN, Circle, Point, Polygon, Pose, Shape
from flexbt_sim.world.specification import ModelSpecification, key

STEP: Final = 0.02
"""Default simulation step, s: speeds are constant for this simulated time."""


@dataclass(frozen=True)
class DriveModel(ModelSpecification):
    """Wheels and motors. Commands are clamped to the limits. The defaults are those of a TurtleBot3 Waffle."""

    title: ClassVar[str] = 'drive'

    linear_speed: float = key('maximum speed, forward and backward', 0.26, unit='m/s', low=0.01, high=30.0)
    angular_speed: float = key('maximum turning speed', 1.82, unit='rad/s', low=0.01, high=30.0)
    linear_acceleration: float = key('maximum acceleration and deceleration', 2.5, unit='m/s²', low=0.01, high=1000.0)
    angular_acceleration: float = key('maximum angular acceleration', 3.2, unit='rad/s²', low=0.01, high=1000.0)
    turning_radius: float = key('minimum turning radius; 0 if the robot can turn in place', 0.0, unit='m', low=0.0,
                                high=100.0)  # fmt: skip
    wheel_separation: float = key('distance between the left and right wheels', 0.287, unit='m', low=0.01, high=10.0)
    slip: float = key('average fraction of the motion lost to wheel slip', 0.0, low=0.0, high=0.5)
    watchdog: float = key('the robot brakes after this time without a command', 0.5, unit='s', low=0.01, high=3600.0)


@dataclass(frozen=True)
class OdometryModel(ModelSpecification):
    """Errors of the odometry. By default it is exact."""

    title: ClassVar[str] = 'odometry'

    linear_noise: float = key('standard deviation after one metre; grows with the square root of the distance', 0.0,
                              unit='m', low=0.0, high=1.0)  # fmt: skip
    angular_noise: float = key('standard deviation after one radian; grows with the square root of the angle', 0.0,
                               unit='rad', low=0.0, high=1.0)  # fmt: skip
    drift: float = key('false rotation measured per metre driven', 0.0, unit='rad/m', low=-1.0, high=1.0)
    scale: float = key('distance measured per metre driven', 1.0, low=0.5, high=2.0)


@dataclass(frozen=True)
class RobotModel(ModelSpecification):
    """A robot model. ``null`` omits a device."""

    title: ClassVar[str] = 'robot'

    footprint: Shape = key(
        'outline around base_link: a radius, [length, width], or the corners of a polygon', Circle(0.22)
    )
    drive: DriveModel = key('wheels and motors', DriveModel())
    odometry: OdometryModel = key('errors of the odometry', OdometryModel())
    lidar: LidarModel | None = key('lidar', LidarModel())
    range_finder: RangeFinderModel | None = key('range finder, such as a sonar', None)
    imu: ImuModel | None = key('inertial measurement unit', None)
    bumper: bool = key('has a bumper that detects contact', False)
    battery: BatteryModel | None = key('battery', None)
    gripper: GripperModel | None = key('gripper', None)


DEVICES: Final[tuple[type[Device], ...]] = (Battery, Bumper, Gripper, Lidar, RangeFinder, Imu)
"""All devices that a robot can carry, in the order in which they publish at the same time."""

BURGER: Final = RobotModel(
    footprint=Circle(0.105),
    drive=DriveModel(linear_speed=0.22, angular_speed=2.84, wheel_separation=0.16),
    lidar=LidarModel(pose=Pose(-0.032, 0.0, 0.0)),
    battery=BatteryModel(capacity=19.98),
)
WAFFLE: Final = RobotModel(lidar=LidarModel(pose=Pose(-0.064, 0.0, 0.0)), battery=BatteryModel(capacity=19.98))
CAR: Final = RobotModel(
    footprint=Polygon(((3.4, 0.9), (3.4, -0.9), (-0.9, -0.9), (-0.9, 0.9))),
    drive=DriveModel(
        linear_speed=8.0,
        angular_speed=1.0,
        linear_acceleration=3.0,
        angular_acceleration=2.0,
        turning_radius=5.0,
        wheel_separation=1.6,
    ),
    lidar=LidarModel(beams=720, range_min=0.3, range_max=60.0, noise=0.03, rate=10.0, pose=Pose(3.2, 0.0, 0.0)),
    battery=BatteryModel(capacity=50_000.0, voltage=400.0, idle=500.0, driving=20_000.0, charging=11_000.0),
)
MODELS: Final[Mapping[str, RobotModel]] = {'burger': BURGER, 'waffle': WAFFLE, 'car': CAR}
"""The included models. TurtleBot3 speeds and outlines come from its data sheets and from Nav2."""


@dataclass(frozen=True)
class WalkModel(ModelSpecification):
    """A random walk: straight ahead until it is blocked or takes a new direction."""

    title: ClassVar[str] = 'random walk'

    speed: float = key('speed', 0.5, unit='m/s', low=0.01, high=30.0)
    period: float = key('average time between turns', 5.0, unit='s', low=0.1, high=3600.0)


@dataclass(frozen=True)
class RouteModel(ModelSpecification):
    """A route along points at constant speed. A blocked obstacle waits, and turns back when its patience ends."""

    title: ClassVar[str] = 'route'

    waypoints: tuple[Point, ...] = key('points to visit after the start pose: [[x, y], ...]', unit='m')
    speed: float = key('speed', 0.5, unit='m/s', low=0.01, high=30.0)
    order: str = key('what to do after the last point', 'loop', choices=('loop', 'back_and_forth', 'once'))
    patience: float = key('time blocked before it turns back; not used with `once`', 10.0, unit='s',
                          low=0.1, high=1e6)  # fmt: skip

    def conflicts(self) -> Iterable[str]:
        if not 1 <= len(self.waypoints) <= 10_000:
            yield f'{len(self.waypoints)} waypoints; give 1 to 10000'


@dataclass(frozen=True)
class ObstacleModel(ModelSpecification):
    """A static or moving obstacle. A moving obstacle keeps its heading."""

    title: ClassVar[str] = 'obstacle'

    pose: Pose = key('start pose')
    shape: Shape = key('outline: a radius, [length, width], or the corners of a polygon', Circle(0.25))
    route: RouteModel | None = key('route to follow, if it moves', None)
    random_walk: WalkModel | None = key('random walk, if it moves without a route', None)

    def conflicts(self) -> Iterable[str]:
        if self.route is not None and self.random_walk is not None:
            yield 'it has a route and a random_walk; leave one of them out'


@dataclass(frozen=True)
class DoorModel(ModelSpecification):
    """A sliding door. It stops before anything in its way."""

    title: ClassVar[str] = 'door'

    from_: Point = key('end where the gap opens: [x, y]', unit='m')
    to: Point = key('end that the door slides to when it opens: [x, y]', unit='m')
    thickness: float = key('thickness of the door leaf', 0.06, unit='m', low=0.01, high=1.0)
    open: bool = key('is open at the start', False)
    opening_time: float = key('time from closed to open', 2.0, unit='s', low=0.01, high=3600.0)
    automatic: bool = key('opens also for robots and moving obstacles, and closes by itself', False)
    range: float = key('detection range of an automatic door, from its middle', 1.5, unit='m', low=0.1,
                       high=100.0)  # fmt: skip
    hold: float = key(
        'time after they leave, or after a command, until an automatic door closes', 3.0, unit='s', low=0.0, high=3600.0
    )

    def conflicts(self) -> Iterable[str]:
        if not 0.05 <= self.length <= 100.0:
            yield f'a door of {self.length:g} m; give 0.05 to 100 m from one end to the other'

    @property
    def length(self) -> float:
        """Length from one end to the other, m."""
        return math.dist(self.from_, self.to)

    def at(self, pose: Pose) -> DoorModel:
        """Return the same elsewhere: the end that it slides away from is at the pose, the other one in its
        direction."""
        x, y, yaw = pose
        return replace(self, from_=(x, y), to=(x + self.length * math.cos(yaw), y + self.length * math.sin(yaw)))


@dataclass(frozen=True)
class StationModel(ModelSpecification):
    """A charging station. It charges a robot that stands still within reach."""

    title: ClassVar[str] = 'station'

    pose: Pose = key('pose at which a robot is charged')
    reach: float = key('maximum distance of the robot from that position', 0.15, unit='m', low=0.01, high=10.0)


@dataclass(frozen=True)
class ZoneModel(ModelSpecification):
    """An area with a rule. It does not block robots physically.

    Navigation avoids a ``no_go`` zone, and the simulator logs and counts robots that enter. A ``slow`` zone limits the
    speed of robots in it. In a ``sensor_shadow`` the lidar and range finder of a robot return nothing, and its
    localization uses odometry only.
    """

    title: ClassVar[str] = 'zone'

    kind: str = key('rule: `no_go`, `slow` or `sensor_shadow`', choices=('no_go', 'slow', 'sensor_shadow'))
    area: Shape = key('outline: a radius, [length, width], or the corners of a polygon')
    pose: Pose = key('origin of the area', ORIGIN)
    speed: float = key('maximum speed in a slow zone', 0.1, unit='m/s', low=0.0, high=30.0)
