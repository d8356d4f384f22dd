# SPDX-License-Identifier: BSD-3-Clause
"""Ray casting: the ranges of beams on a map with bodies.

Obstacles are solid, as they are for robots. In a body or on its outline, every beam has range 0. A beam hits a cell of
the map if it enters it: a beam that starts on its edge and leads away does not.
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
    """A fan of beams from a pose in the map, with the direction of the first beam and the angle between beams, rad.

    ``range_max`` is the maximum range, m; ``owner`` is the number of the body that the beams ignore.
    """

    pose: Pose
    angle_min: float
    angle_increment: float
    beams: int
    range_max: float
    owner: int


class Outlines(NamedTuple):
    """The outlines of bodies for ray casting.

    ``circles`` are rows of x, y, radius and number of the body; ``segments`` are rows of x, y, x, y and this number.
    """

    circles: Floats
    segments: Floats


def outlines(bodies: Iterable[Body]) -> Outlines:
    """Return the outlines of bodies, numbered in their order."""
    circles: list[tuple[float, ...]] = []
    segments: list[tuple[float, ...]] = []
    for number, body in enumerate(bodies):
        if isinstance(body.shape, Circle):
            circles.append((body.pose.x, body.pose.y, body.shape.radius, number))
        else:
            segments += [(*side, number) for side in body.shape.sides(body.pose)]
    return Outlines(numpy.array(circles).reshape(-1, 4), numpy.array(segments).reshape(-1, 5))


class RayCaster:
    """A ray caster for any number of sensors, one after the other."""

    def __init__(self, world: OccupancyMap | None) -> None:
        self._world = world

    def cast(self, sensors: Sequence[Beams], bodies: Outlines) -> list[Floats]:
        """Return the range of each beam, m, by sensor; infinite for a beam that hits nothing within its range."""
        with numpy.errstate(over='ignore'):  # a side that is almost parallel to a beam is hit at infinity
            return [self._one(sensor, bodies) for sensor in sensors]

    @cached_property
    def _free(self) -> NDArray[numpy.float32]:
        """Free distance, in cells, of a beam from anywhere in each cell; less than -0.5 for an obstacle."""
        world = self._world
        if world is None:
            return numpy.ones((1, 1), numpy.float32)  # a free cell that beams leave immediately
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
