# SPDX-License-Identifier: BSD-3-Clause
"""The lidar: how it is described, how its scans come about, and its faults."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any, ClassVar, NamedTuple

import numpy
from numpy.typing import NDArray

from flexbt_sim.world.devices.device import Carrier, DeviceFault, Sensor
from flexbt_sim.world.plane.geometry import ORIGIN, Pose, compose
from flexbt_sim.world.plane.ray_casting import Beams, Floats
from flexbt_sim.world.specification import ModelSpecification, key


@dataclass(frozen=True)
class LidarModel(ModelSpecification):
    """A planar lidar. Its beams are evenly spaced, counter-clockwise: from straight ahead all round, or over a field of
    view that lies evenly to both sides of straight ahead. Bodies are solid: in another one, or on its outline, all
    ranges are 0."""

    title: ClassVar[str] = 'lidar'

    beams: int = key('beams of a scan', 360, low=1, high=100_000)
    range_min: float = key('least range that is measured; nearer is minus infinity (REP 117)', 0.12, unit='m', low=0.0)
    range_max: float = key('greatest range; farther is infinity', 3.5, unit='m', low=0.01, high=1000.0)
    noise: float = key('standard deviation of a range', 0.01, unit='m', low=0.0, high=10.0)
    rate: float = key('scans per second', 5.0, unit='Hz', low=0.01, high=1000.0)
    dropout: float = key('probability that a beam returns nothing', 0.0, low=0.0, high=1.0)
    field_of_view: float = key(
        'angle between the first and the last beam; 2 pi for all round', math.tau, unit='rad', low=0.0, high=math.tau
    )
    pose: Pose = key('where it is on the robot', ORIGIN)

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
    """Beams in a direction return nothing, as in glare."""

    name: ClassVar[str] = 'lidar_blinded'
    needs: ClassVar[str] = 'lidar'
    direction: float = key('the middle of it; 0 is straight ahead', 0.0, unit='rad', low=-math.pi, high=math.pi)
    width: float = key('how wide it is; 2 pi for all beams', math.tau, unit='rad', low=0.0, high=math.tau)


class Scan(NamedTuple):
    """A scan of a lidar: simulated time, s, and the range of each beam, m.

    Infinite where nothing is within range, and minus infinity where it is too near (REP 117).
    """

    time: float
    ranges: NDArray[numpy.float32]


class Lidar(Sensor):
    """The lidar of a robot. ``scan`` is the last one."""

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
    def pose(self) -> Pose:
        return self.model.pose

    @property
    def scan(self) -> Scan | None:
        """The last scan."""
        return None if self.time is None else Scan(self.time, self._ranges)

    def draw(self) -> tuple[NDArray[numpy.float64], NDArray[numpy.bool_] | None]:
        """Return for each beam its noise, in standard deviations, and whether it is lost, if any may be."""
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
