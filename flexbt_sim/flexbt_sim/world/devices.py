# SPDX-License-Identifier: BSD-3-Clause
"""The devices that a robot may carry: their models, readings and faults."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any, ClassVar, Final, NamedTuple

import numpy
from numpy.typing import NDArray

from flexbt_sim.world.device import Carrier, Device, DeviceFault, Sensor
from flexbt_sim.world.plane.geometry import ORIGIN, Pose, compose
from flexbt_sim.world.plane.ray_casting import Beams, Floats
from flexbt_sim.world.specification import ModelSpecification, key


@dataclass(frozen=True)
class BatteryModel(ModelSpecification):
    """A battery. When it is empty, the robot stops and its other sensors publish nothing."""

    title: ClassVar[str] = 'battery'

    capacity: float = key('energy when fully charged', 20.0, unit='Wh', low=0.001, high=1e6)
    level: float = key('charge at the start; 1 is full', 1.0, low=0.0, high=1.0)
    voltage: float = key('nominal voltage', 11.1, unit='V', low=1.0, high=1000.0)
    idle: float = key('power while the robot stands still', 5.0, unit='W', low=0.0, high=1e6)
    driving: float = key('additional power at maximum speed; proportional below', 10.0, unit='W', low=0.0,
                         high=1e6)  # fmt: skip
    charging: float = key('power from a charging station', 60.0, unit='W', low=0.0, high=1e6)


@dataclass(frozen=True)
class BatteryLow(DeviceFault):
    """The battery drops to a level immediately. The charge does not return when the fault ends."""

    name: ClassVar[str] = 'battery_low'
    needs: ClassVar[str] = 'battery'
    level: float = key('remaining charge; 1 is full', 0.1, low=0.0, high=1.0)


class Battery(Sensor):
    """A battery: its ``level`` from 0 to 1, whether it is charging, and its input power, W."""

    name = 'battery'
    topics = ('battery_state', 'battery_status')
    message = 'sensor_msgs/BatteryState'
    fields = (('', 'current'), ('', 'charge'), ('', 'percentage'), ('', 'power_supply_status'))
    is_prompt = False
    samples = 0
    needs_power = False
    rate = 1.0
    model: BatteryModel

    DISCHARGING: ClassVar[int] = 2
    CHARGING: ClassVar[int] = 1
    FULL: ClassVar[int] = 4
    """Values of ``power_supply_status``."""

    def reset(self) -> None:
        super().reset()
        self.level = self.model.level
        self.is_charging = False
        self.power = 0.0
        self._values = (0.0, 0.0, 0.0, self.DISCHARGING)

    def begin(self, slot: str, fault: DeviceFault) -> None:
        super().begin(slot, fault)
        if isinstance(fault, BatteryLow):
            self.level = fault.level

    def run(self, power: float, duration: float) -> None:
        """Draw power, W, for a time, s; the battery charges at the same time if it is connected to a charger."""
        gained = (self.model.charging if self.is_charging else 0.0) - power
        level = self.level + gained * duration / (3600.0 * self.model.capacity)
        self.level = min(1.0, max(0.0, level))
        self.power = gained if self.level == level else 0.0  # the battery is full or empty

    @property
    def state(self) -> float:
        return self.level

    @property
    def _charge(self) -> float:
        """Charge of a full battery, Ah."""
        return self.model.capacity / self.model.voltage

    def constants(self) -> Mapping[str, Any]:
        return {
            'voltage': self.model.voltage,
            'temperature': math.nan,
            'capacity': self._charge,
            'design_capacity': self._charge,
            'power_supply_health': 1,  # good
            'power_supply_technology': 2,  # lithium ions
            'present': True,
        }

    def measure(self, drawn: object, ranges: object) -> None:
        charging = self.FULL if self.level >= 1.0 else self.CHARGING
        status = charging if self.is_charging else self.DISCHARGING
        self._values = self.power / self.model.voltage, self._charge * self.level, self.level, status

    def values(self) -> tuple[float, float, float, int]:
        return self._values


class Bumper(Device):
    """A bumper, which detects contacts."""

    name = 'bumper'
    topics = ('bumper',)
    message = 'std_msgs/Bool'
    fields = (('', 'data'),)
    is_latched = True

    @property
    def news(self) -> bool:
        return self.robot.in_contact

    @property
    def state(self) -> bool:
        return self.robot.in_contact

    def values(self) -> tuple[bool]:
        return (self.robot.in_contact,)


@dataclass(frozen=True)
class GripperModel(ModelSpecification):
    """An arm with a gripper, which picks up obstacles that rest, and puts them down straight ahead."""

    title: ClassVar[str] = 'gripper'

    reach: float = key('maximum pick and place distance from the robot center', 0.6, unit='m', low=0.01,
                       high=10.0)  # fmt: skip
    opening: float = key('maximum radius of an object that it can pick up', 0.1, unit='m', low=0.001, high=10.0)


class Gripper(Device):
    """A gripper. ``holds`` is the name of the obstacle that it holds, '' for none."""

    name = 'gripper'
    topics = ('gripper_holds',)
    message = 'std_msgs/String'
    fields = (('', 'data'),)
    is_latched = True
    model: GripperModel
    holds = ''

    @property
    def news(self) -> str:
        return self.holds

    @property
    def state(self) -> str:
        return self.holds

    def values(self) -> tuple[str]:
        return (self.holds,)


@dataclass(frozen=True)
class LidarModel(ModelSpecification):
    """A planar lidar. Its beams are evenly spaced, counter-clockwise: from straight ahead all round, or over a field of
    view that lies evenly to both sides of straight ahead. Bodies are solid: in another one, or on its outline, all
    ranges are 0."""

    title: ClassVar[str] = 'lidar'

    beams: int = key('beams per scan', 360, low=1, high=100_000)
    range_min: float = key('minimum range; reports -inf if closer (REP 117)', 0.12, unit='m', low=0.0)
    range_max: float = key('maximum range; reports +inf if farther', 3.5, unit='m', low=0.01, high=1000.0)
    noise: float = key('standard deviation of the range', 0.01, unit='m', low=0.0, high=10.0)
    rate: float = key('scans per second', 5.0, unit='Hz', low=0.01, high=1000.0)
    dropout: float = key('probability that a beam returns nothing', 0.0, low=0.0, high=1.0)
    field_of_view: float = key(
        'angle between the first and last beams; 2 pi for a full circle', math.tau, unit='rad', low=0.0, high=math.tau
    )
    pose: Pose = key('pose on the robot', ORIGIN)

    def conflicts(self) -> Iterable[str]:
        if self.range_min >= self.range_max:
            yield f'range_min of {self.range_min:g} m is not below range_max of {self.range_max:g} m'

    @property
    def is_all_round(self) -> bool:
        """True if the last beam is next to the first one."""
        return self.field_of_view > math.tau - 1e-6

    @property
    def angle_min(self) -> float:
        """Direction of the first beam, rad."""
        return 0.0 if self.is_all_round else -self.field_of_view / 2.0

    @property
    def angle_increment(self) -> float:
        """Angle between two beams, rad."""
        return math.tau / self.beams if self.is_all_round else self.field_of_view / max(1, self.beams - 1)


@dataclass(frozen=True)
class LidarFrozen(DeviceFault):
    """Each scan is a copy of the last one before the fault, with a new time."""

    name: ClassVar[str] = 'lidar_frozen'
    needs: ClassVar[str] = 'lidar'
    freezes: ClassVar[bool] = True


@dataclass(frozen=True)
class LidarBlinded(DeviceFault):
    """Beams in one sector return nothing, as in glare."""

    name: ClassVar[str] = 'lidar_blinded'
    needs: ClassVar[str] = 'lidar'
    direction: float = key('center of the sector; 0 is straight ahead', 0.0, unit='rad', low=-math.pi, high=math.pi)
    width: float = key('width of the sector; 2 pi for all beams', math.tau, unit='rad', low=0.0, high=math.tau)


class Scan(NamedTuple):
    """A scan of a lidar: simulated time, s, and the range of each beam, m.

    A range is infinite if nothing is within range, and minus infinity if something is too near (REP 117).
    """

    time: float
    ranges: NDArray[numpy.float32]


class Lidar(Sensor):
    """The lidar of a robot. ``scan`` is its last scan."""

    name = 'lidar'
    topics = ('scan',)
    message = 'sensor_msgs/LaserScan'
    frame = 'base_scan'
    array = 'ranges'
    casts = True
    model: LidarModel

    def __init__(self, robot: Carrier, model: LidarModel) -> None:
        super().__init__(robot, model)
        self._ranges: NDArray[numpy.float32] = numpy.empty(0, numpy.float32)

    @property
    def scan(self) -> Scan | None:
        """The last scan."""
        return None if self.time is None else Scan(self.time, self._ranges)

    def draw(self) -> tuple[NDArray[numpy.float64], NDArray[numpy.bool_] | None]:
        """Return the noise of each beam, in standard deviations, and which beams are lost, or None if none can be."""
        noise = self._random.standard_normal(self.model.beams)
        return noise, self._random.random(self.model.beams) < self.model.dropout if self.model.dropout else None

    def beams(self, number: int) -> Beams:
        model = self.model
        pose = compose(self.robot.pose, model.pose)
        return Beams(pose, model.angle_min, model.angle_increment, model.beams, model.range_max, number)

    def measure(self, drawn: tuple[NDArray[numpy.float64], NDArray[numpy.bool_] | None], ranges: Floats) -> None:
        model, (noise, lost) = self.model, drawn
        if self.robot.in_shadow:
            ranges = numpy.full(model.beams, math.inf)
        seen = ranges + model.noise * self.noise_factor * noise
        seen[seen > model.range_max] = math.inf
        seen[seen < model.range_min] = -math.inf
        if lost is not None:
            seen[lost] = math.inf
        for blinded in self.faults.values():
            if isinstance(blinded, LidarBlinded):
                angles = model.angle_min + numpy.arange(model.beams) * model.angle_increment
                away = (angles - blinded.direction + math.pi) % math.tau - math.pi
                seen[numpy.abs(away) <= blinded.width / 2.0] = math.inf
        self._ranges = seen.astype(numpy.float32)

    def constants(self) -> Mapping[str, Any]:
        model = self.model
        return {
            'angle_min': model.angle_min,
            'angle_max': model.angle_min + model.angle_increment * (model.beams - 1),
            'angle_increment': model.angle_increment,
            'scan_time': 1.0 / model.rate,
            'range_min': model.range_min,
            'range_max': model.range_max,
            'ranges': [0.0] * model.beams,
        }

    def array_values(self) -> NDArray[numpy.float32]:
        return self._ranges


BEAM_ANGLE: Final = math.radians(2.0)
"""Maximum angle between adjacent beams that fill the cone, rad."""


@dataclass(frozen=True)
class RangeFinderModel(ModelSpecification):
    """A range finder, such as a sonar. It measures the distance of the nearest thing in its cone."""

    title: ClassVar[str] = 'range finder'

    radiation: str = key('type of sensor', 'ultrasound', choices=('ultrasound', 'infrared'))
    field_of_view: float = key('angle of the cone', 0.26, unit='rad', low=0.0, high=math.pi)
    range_min: float = key('minimum range; reports -inf if closer (REP 117)', 0.02, unit='m', low=0.0)
    range_max: float = key('maximum range; reports +inf if farther', 4.0, unit='m', low=0.01, high=1000.0)
    noise: float = key('standard deviation of the range', 0.01, unit='m', low=0.0, high=10.0)
    rate: float = key('readings per second', 10.0, unit='Hz', low=0.01, high=1000.0)
    pose: Pose = key('pose on the robot', ORIGIN)

    def conflicts(self) -> Iterable[str]:
        if self.range_min >= self.range_max:
            yield f'range_min of {self.range_min:g} m is not below range_max of {self.range_max:g} m'


class RangeFinder(Sensor):
    """The range finder of a robot. ``range`` is its last reading, m, as in :class:`Scan`."""

    name = 'range_finder'
    topics = ('range',)
    message = 'sensor_msgs/Range'
    frame = 'range_finder_link'
    fields = (('f', 'range'),)
    casts = True
    model: RangeFinderModel
    range = math.inf

    def beams(self, number: int) -> Beams:
        model = self.model
        gaps = max(1, math.ceil(model.field_of_view / BEAM_ANGLE))
        pose = compose(self.robot.pose, model.pose)
        return Beams(pose, -model.field_of_view / 2.0, model.field_of_view / gaps, gaps + 1, model.range_max, number)

    def measure(self, drawn: NDArray[Any], ranges: Floats) -> None:
        model = self.model
        nearest = math.inf if self.robot.in_shadow else float(ranges.min())
        seen = nearest + model.noise * self.noise_factor * float(drawn[0])
        self.range = math.inf if seen > model.range_max else -math.inf if seen < model.range_min else seen

    def constants(self) -> Mapping[str, Any]:
        model = self.model
        return {
            'radiation_type': ('ultrasound', 'infrared').index(model.radiation),
            'field_of_view': model.field_of_view,
            'min_range': model.range_min,
            'max_range': model.range_max,
        }

    def values(self) -> tuple[float]:
        return (self.range,)


GRAVITY: Final = 9.80665
"""Acceleration upwards that an IMU at rest measures, m/s² (REP 145)."""


@dataclass(frozen=True)
class ImuModel(ModelSpecification):
    """An inertial measurement unit: a gyroscope and an accelerometer, without an estimate of the orientation. It
    measures the motion over ground, which slipping or stuck wheels do not."""

    title: ClassVar[str] = 'imu'

    angular_noise: float = key('standard deviation of the angular velocity', 0.01, unit='rad/s', low=0.0, high=10.0)
    angular_bias: float = key('constant error of the angular velocity', 0.0, unit='rad/s', low=-1.0, high=1.0)
    linear_noise: float = key('standard deviation of each acceleration', 0.02, unit='m/s²', low=0.0, high=100.0)
    rate: float = key('readings per second', 50.0, unit='Hz', low=0.01, high=1000.0)
    pose: Pose = key('pose on the robot', ORIGIN)


class Imu(Sensor):
    """The IMU of a robot. Its last reading: ``angular_velocity``, rad/s, ``acceleration``, m/s² along its x and y."""

    name = 'imu'
    topics = ('imu',)
    message = 'sensor_msgs/Imu'
    frame = 'imu_link'
    fields = (('d', 'angular_velocity.z'), ('d', 'linear_acceleration.x'), ('d', 'linear_acceleration.y'))
    samples = 3
    model: ImuModel

    def reset(self) -> None:
        super().reset()
        self.angular_velocity, self.acceleration = 0.0, (0.0, 0.0)
        self._twist = self._change = (0.0, 0.0)
        self._since = -math.inf

    def comes_due(self, now: float) -> bool:
        """Compute the acceleration since the last reading was due, even if no subscriber reads it."""
        if now + 1e-9 >= self.due:
            duration, (linear, angular), (was_linear, was_angular) = now - self._since, self.robot.twist, self._twist
            if duration > 0.0:
                self._change = (linear - was_linear) / duration, (angular - was_angular) / duration
            self._since, self._twist = now, (linear, angular)
        return super().comes_due(now)

    def measure(self, drawn: NDArray[Any], ranges: object) -> None:
        model, pose = self.model, self.model.pose
        (linear, angular), (change, angular_change) = self.robot.twist, self._change
        ahead = change - angular_change * pose.y - angular**2 * pose.x
        left = linear * angular + angular_change * pose.x - angular**2 * pose.y
        cos, sin = math.cos(pose.yaw), math.sin(pose.yaw)
        turn, x, y = (self.noise_factor * drawn).tolist()
        self.angular_velocity = angular + model.angular_bias + model.angular_noise * turn
        self.acceleration = (
            ahead * cos + left * sin + model.linear_noise * x,
            left * cos - ahead * sin + model.linear_noise * y,
        )

    def constants(self) -> Mapping[str, Any]:
        return {
            'orientation_covariance': [-1.0] + [0.0] * 8,  # it does not measure the orientation
            'linear_acceleration.z': GRAVITY,
            'angular_velocity_covariance': _diagonal(self.model.angular_noise**2),
            'linear_acceleration_covariance': _diagonal(self.model.linear_noise**2),
        }

    def values(self) -> tuple[float, float, float]:
        return self.angular_velocity, *self.acceleration


def _diagonal(variance: float) -> list[float]:
    return [variance, 0.0, 0.0, 0.0, variance, 0.0, 0.0, 0.0, variance]
