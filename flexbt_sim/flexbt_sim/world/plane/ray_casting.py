# SPDX-License-Identifier: BSD-3-Clause
"""Ray casting: the ranges of beams on a map with bodies.

Obstacles are solid, as they are to robots. From within a body, or on its outline, every beam gets 0 m far. A cell of
the map is met by the beams that go into it: from its edge, not by those that lead away.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from functools import cached_property
from typing import Any, Final, NamedTuple

import numpy
from numpy.typing import NDArray

from .geometry import Circle, Pose
from .loops import cast, covers
from .occupancy_map import OccupancyMap
from .space import Body

_HALF_DIAGONAL: Final = 0.71
"""Half the diagonal of a cell, rounded up."""

Floats = NDArray[numpy.floating[Any]]


class Beams(NamedTuple):
    """A fan of beams from a pose in the map: the direction of the first one and the angle from each to the next, rad.

    ``range_max`` is as far as anything is looked for, m; ``owner`` the number of the body that is not seen.
    """

    pose: Pose
    angle_min: float
    angle_increment: float
    beams: int
    range_max: float
    owner: int


class Outlines(NamedTuple):
    """The outlines of bodies as beams meet them.

    ``circles`` are rows of x, y, radius and number of the body, ``segments`` rows of x, y, x, y and this number.
    """

    circles: Floats
    segments: Floats


def outlines(bodies: Iterable[Body]) -> Outlines:
    """Return the outlines of bodies, which are numbered in their order."""
    circles: list[tuple[float, ...]] = []
    segments: list[tuple[float, ...]] = []
    for number, body in enumerate(bodies):
        if isinstance(body.shape, Circle):
            circles.append((body.pose.x, body.pose.y, body.shape.radius, number))
        else:
            segments += [(*side, number) for side in body.shape.sides(body.pose)]
    return Outlines(numpy.array(circles).reshape(-1, 4), numpy.array(segments).reshape(-1, 5))


class RayCaster:
    """A caster of the beams of any number of sensors, one after the other."""

    def __init__(self, world: OccupancyMap | None) -> None:
        self._world = world

    def cast(self, sensors: Sequence[Beams], bodies: Outlines) -> list[Floats]:
        """For each sensor, how far each beam gets, m; infinite where it meets nothing within its range."""
        with numpy.errstate(over='ignore'):  # a side that is all but parallel to a beam is met infinitely far away
            return [self._one(sensor, bodies) for sensor in sensors]

    @cached_property
    def _free(self) -> NDArray[numpy.float32]:
        """Free distance of a beam from anywhere in each cell, in cells; less than -0.5 for an obstacle."""
        world = self._world
        if world is None:
            return numpy.ones((1, 1), numpy.float32)  # which beams leave at once
        return numpy.ascontiguousarray(world.distances / world.resolution, numpy.float32) - numpy.float32(
            _HALF_DIAGONAL
        )

    def _one(self, sensor: Beams, bodies: Outlines) -> Floats:
        (x, y, yaw), world = sensor.pose, self._world
        if covers(x, y, sensor.owner, *bodies):
            return numpy.zeros(sensor.beams)
        row, column = (-2.0, -2.0) if world is None else world.grid_position(x, y)
        turned, resolution = (0.0, 1.0) if world is None else (world.origin.yaw, world.resolution)
        ranges = numpy.empty(sensor.beams)
        cast(
            self._free, row, column, turned, resolution, x, y, yaw + sensor.angle_min, sensor.angle_increment,
            sensor.range_max, sensor.owner, *bodies, ranges,
        )  # fmt: skip
        return ranges
