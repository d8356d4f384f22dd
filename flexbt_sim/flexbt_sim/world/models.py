# SPDX-License-Identifier: BSD-3-Clause
"""The descriptions of robots and of the things around them in world files."""

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
"""Simulated time, s, for which speeds are taken as constant, unless a world file says another."""


@dataclass(frozen=True)
class DriveModel(ModelSpecification):
    """Wheels and motors. A command is cut to the limits; the defaults are those of a TurtleBot3 waffle."""

    title: ClassVar[str] = 'drive'

    linear_speed: float = key('greatest speed, forwards and backwards', 0.26, unit='m/s', low=0.01, high=30.0)
    angular_speed: float = key('greatest speed of turning', 1.82, unit='rad/s', low=0.01, high=30.0)
    linear_acceleration: float = key('greatest change of speed', 2.5, unit='m/s²', low=0.01, high=1000.0)
    angular_acceleration: float = key('greatest change of turning', 3.2, unit='rad/s²', low=0.01, high=1000.0)
    turning_radius: float = key('least radius of a bend; 0 for a robot that turns on the spot', 0.0, unit='m', low=0.0,
                                high=100.0)  # fmt: skip
    wheel_separation: float = key('from the left to the right wheel', 0.287, unit='m', low=0.01, high=10.0)
    slip: float = key('part of the motion that is lost on the ground, on the average', 0.0, low=0.0, high=0.5)
    watchdog: float = key('time without a command after which it brakes', 0.5, unit='s', low=0.01, high=3600.0)


@dataclass(frozen=True)
class OdometryModel(ModelSpecification):
    """Errors of the odometry. By default it is exact."""

    title: ClassVar[str] = 'odometry'

    linear_noise: float = key('standard deviation after one metre; it grows with the root of the way', 0.0,
                              unit='m', low=0.0, high=1.0)  # fmt: skip
    angular_noise: float = key('standard deviation after one radian; it grows with the root of the angle', 0.0,
                               unit='rad', low=0.0, high=1.0)  # fmt: skip
    drift: float = key('turning that is not there, for each metre', 0.0, unit='rad/m', low=-1.0, high=1.0)
    scale: float = key('measured way for each metre', 1.0, low=0.5, high=2.0)


@dataclass(frozen=True)
class RobotModel(ModelSpecification):
    """A kind of robot. ``null`` leaves a device out."""

    title: ClassVar[str] = 'robot'

    footprint: Shape = key(
        'what it takes up round its base_link: a radius, [length, width], or the corners of a polygon', Circle(0.22)
    )
    drive: DriveModel = key('wheels and motors', DriveModel())
    odometry: OdometryModel = key('errors of the odometry', OdometryModel())
    lidar: LidarModel | None = key('its lidar', LidarModel())
    range_finder: RangeFinderModel | None = key('its range finder, such as a sonar', None)
    imu: ImuModel | None = key('its inertial measurement unit', None)
    bumper: bool = key('whether it feels contacts', False)
    battery: BatteryModel | None = key('its battery', None)
    gripper: GripperModel | None = key('its gripper', None)


DEVICES: Final[tuple[type[Device], ...]] = (Battery, Bumper, Gripper, Lidar, RangeFinder, Imu)
"""Everything that a robot may carry, in the order of their messages at one time."""

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
"""The included models; the speeds and outlines of TurtleBot3 are those of its data sheets and of Nav2."""


@dataclass(frozen=True)
class WalkModel(ModelSpecification):
    """A walk without an aim: straight on until it is blocked or wants to go elsewhere."""

    title: ClassVar[str] = 'random walk'

    speed: float = key('speed', 0.5, unit='m/s', low=0.01, high=30.0)
    period: float = key('time from turn to turn, on the average', 5.0, unit='s', low=0.1, high=3600.0)


@dataclass(frozen=True)
class RouteModel(ModelSpecification):
    """A way along points, at a constant speed. An obstacle that moves waits while it is blocked, and finally turns
    back."""

    title: ClassVar[str] = 'route'

    waypoints: tuple[Point, ...] = key('the points, from where it is at the start: [[x, y], ...]', unit='m')
    speed: float = key('speed', 0.5, unit='m/s', low=0.01, high=30.0)
    order: str = key('what comes after the last point', 'loop', choices=('loop', 'back_and_forth', 'once'))
    patience: float = key('time for which it is blocked before it turns back, unless it goes once', 10.0, unit='s',
                          low=0.1, high=1e6)  # fmt: skip

    def conflicts(self) -> Iterable[str]:
        if not 1 <= len(self.waypoints) <= 10_000:
            yield f'{len(self.waypoints)} waypoints; give 1 to 10000'


@dataclass(frozen=True)
class ObstacleModel(ModelSpecification):
    """Something in the way, at rest or moving; what moves keeps its heading."""

    title: ClassVar[str] = 'obstacle'

    pose: Pose = key('where it is at the start')
    shape: Shape = key('what it takes up: a radius, [length, width], or the corners of a polygon', Circle(0.25))
    route: RouteModel | None = key('the way that it takes, if it moves', None)
    random_walk: WalkModel | None = key('its walk, if it moves without an aim', None)

    def conflicts(self) -> Iterable[str]:
        if self.route is not None and self.random_walk is not None:
            yield 'it has a route and a random_walk; leave one of them out'


@dataclass(frozen=True)
class DoorModel(ModelSpecification):
    """A sliding door. It stops before whatever is in its way."""

    title: ClassVar[str] = 'door'

    from_: Point = key('the end that it slides away from: [x, y]; the gap opens here', unit='m')
    to: Point = key('the end that it slides to: [x, y]', unit='m')
    thickness: float = key('thickness of its leaf', 0.06, unit='m', low=0.01, high=1.0)
    open: bool = key('whether it is open at the start', False)
    opening_time: float = key('time from closed to open', 2.0, unit='s', low=0.01, high=3600.0)
    automatic: bool = key('whether it opens for robots and moving obstacles; otherwise by command', False)
    range: float = key('how near to the middle of the door an automatic one sees them', 1.5, unit='m', low=0.1,
                       high=100.0)  # fmt: skip
    hold: float = key('time that an automatic one stays open with nobody near', 3.0, unit='s', low=0.0, high=3600.0)

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
    """A charging station. A robot at rest with its position within reach of it is charged."""

    title: ClassVar[str] = 'station'

    pose: Pose = key('where a robot has to be to be charged')
    reach: float = key('how far from there it may be', 0.15, unit='m', low=0.01, high=10.0)


@dataclass(frozen=True)
class ZoneModel(ModelSpecification):
    """An area with a rule; nothing that stops a robot."""

    title: ClassVar[str] = 'zone'

    kind: str = key(
        '`no_go`: navigation keeps out of it; a robot that enters it anyway is logged and counted; `slow`: '
        'robots in it are held to a speed; `sensor_shadow`: lidar and range finder of a robot in it return nothing, '
        'and its localization goes on by odometry alone',
        choices=('no_go', 'slow', 'sensor_shadow'),
    )
    area: Shape = key('what it covers: a radius, [length, width], or the corners of a polygon')
    pose: Pose = key('its origin', ORIGIN)
    speed: float = key('greatest speed in a slow zone', 0.1, unit='m/s', low=0.0, high=30.0)
