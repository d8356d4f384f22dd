# SPDX-License-Identifier: BSD-3-Clause
"""The range finder: a sonar, or an infrared sensor, which measures how far the nearest thing in its cone is."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any, ClassVar, Final

from numpy.typing import NDArray

from flexbt_sim.world.devices.device import Sensor
from flexbt_sim.world.plane.geometry import ORIGIN, Pose, compose
from flexbt_sim.world.plane.ray_casting import Beams, Floats
from flexbt_sim.world.specification import ModelSpecification, key

BEAM_ANGLE: Final = math.radians(2.0)
"""Greatest angle between two of the beams that the cone is filled with, rad."""


@dataclass(frozen=True)
class RangeFinderModel(ModelSpecification):
    """A range finder, such as a sonar. It measures the distance of the nearest thing in its cone."""

    title: ClassVar[str] = 'range finder'

    radiation: str = key('what it sends', 'ultrasound', choices=('ultrasound', 'infrared'))
    field_of_view: float = key('angle of the cone', 0.26, unit='rad', low=0.0, high=math.pi)
    range_min: float = key('least range that is measured; nearer is minus infinity (REP 117)', 0.02, unit='m', low=0.0)
    range_max: float = key('greatest range; farther is infinity', 4.0, unit='m', low=0.01, high=1000.0)
    noise: float = key('standard deviation of a range', 0.01, unit='m', low=0.0, high=10.0)
    rate: float = key('readings per second', 10.0, unit='Hz', low=0.01, high=1000.0)
    pose: Pose = key('where it is on the robot', ORIGIN)

    def conflicts(self) -> Iterable[str]:
        if self.range_min >= self.range_max:
            yield f'range_min of {self.range_min:g} m is not below range_max of {self.range_max:g} m'


class RangeFinder(Sensor):
    """The range finder of a robot. ``range`` is the last one, m, as in :class:`Scan`."""

    name = 'range_finder'
    topics = ('range',)
    message = 'sensor_msgs/Range'
    frame = 'range_finder_link'
    fields = (('f', 'range'),)
    casts = True
    model: RangeFinderModel
    range = math.inf

    @property
    def pose(self) -> Pose:
        return self.model.pose

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
