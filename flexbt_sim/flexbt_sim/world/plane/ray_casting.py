# SPDX-License-Identifier: BSD-3-Clause
"""Ray casting: the ranges of beams on a map with bodies.

Obstacles are solid, as they are to robots. From within a body, or on its outline, every beam gets 0 m far. A cell of
the map is met by the beams that go into it: from its edge, not by those that lead away.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from functools import cached_property
from typing import Any, Final, NamedTuple

import numpy
from numpy.typing import NDArray

from . import loops
from .bodies import Body
from .geometry import Circle, Pose
from .loops import compiled
from .occupancy_map import OccupancyMap

_BEYOND: Final = 1e-6
"""Distance by which a beam has to enter the next cell to be in it, in cells."""

_ROUNDING: Final = 1e-9
"""Part of a side by which it is longer, so that no beam slips between two sides."""

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
    """A caster of the beams of any number of sensors: one after the other with numba, otherwise all at once."""

    def __init__(self, world: OccupancyMap | None) -> None:
        self._world = world

    def cast(self, sensors: Sequence[Beams], bodies: Outlines) -> list[Floats]:
        """For each sensor, how far each beam gets, m; infinite where it meets nothing within its range."""
        cast = compiled(loops.cast)
        return self.cast_at_once(sensors, bodies) if cast is None else [self._one(cast, one, bodies) for one in sensors]

    @cached_property
    def _free(self) -> NDArray[numpy.float32]:
        """Free distance of a beam from anywhere in each cell, in cells; less than -0.5 for an obstacle."""
        world = self._world
        if world is None:
            return numpy.ones((1, 1), numpy.float32)  # which beams leave at once
        return numpy.ascontiguousarray(world.distances / world.resolution, numpy.float32) - numpy.float32(
            _HALF_DIAGONAL
        )

    def _one(self, cast: Callable[..., None], sensor: Beams, bodies: Outlines) -> Floats:
        if _starts_in_one(sensor, bodies):
            return numpy.zeros(sensor.beams)
        (x, y, yaw), world = sensor.pose, self._world
        row, column = (-2.0, -2.0) if world is None else world.grid_position(x, y)
        turned, resolution = (0.0, 1.0) if world is None else (world.origin.yaw, world.resolution)
        ranges = numpy.empty(sensor.beams)
        cast(
            self._free, row, column, turned, resolution, x, y, yaw + sensor.angle_min, sensor.angle_increment,
            sensor.range_max, sensor.owner, bodies.circles, bodies.segments, ranges,
        )  # fmt: skip
        return ranges

    def cast_at_once(self, sensors: Sequence[Beams], bodies: Outlines) -> list[Floats]:
        """Return the same by whole-array operations."""
        angles = [one.pose.yaw + one.angle_min + numpy.arange(one.beams) * one.angle_increment for one in sensors]
        if self._world is None:
            found: list[Floats] = [numpy.full(one.beams, math.inf) for one in sensors]
        else:
            found = self._cast_on_map(self._world, sensors, angles)
        for sensor, heading, ranges in zip(sensors, angles, found, strict=True):
            if _starts_in_one(sensor, bodies):
                ranges.fill(0.0)
                continue
            _cast_on_bodies(sensor, numpy.cos(heading), numpy.sin(heading), bodies, ranges)
            ranges[ranges > sensor.range_max] = math.inf
        return found

    def _cast_on_map(self, world: OccupancyMap, sensors: Sequence[Beams], angles: Sequence[Floats]) -> list[Floats]:
        counts = [one.beams for one in sensors]
        headings = numpy.concatenate(angles) - world.origin.yaw
        directions = numpy.stack([numpy.sin(headings), numpy.cos(headings)])  # in rows and columns
        directions[numpy.abs(directions) < 1e-12] = 1e-12
        starts = numpy.array([world.grid_position(one.pose.x, one.pose.y) for one in sensors]).T.repeat(counts, axis=1)
        limits = numpy.repeat([one.range_max / world.resolution for one in sensors], counts)
        ranges = _march(world, starts, directions, limits) * world.resolution
        return numpy.split(ranges, numpy.cumsum(counts)[:-1])


def _march(world: OccupancyMap, starts: Floats, directions: Floats, limits: Floats) -> Floats:
    """Return how far beams get from positions in directions, both (2, n), in cells; infinite where they hit nothing."""
    size = numpy.array([[world.height], [world.width]])
    borders = numpy.stack([-starts / directions, (size - starts) / directions])
    travelled = numpy.maximum(borders.min(axis=0).max(axis=0), 0.0) + _BEYOND
    ends = numpy.minimum(borders.max(axis=0).min(axis=0), limits + 1.0) - _BEYOND
    ranges = numpy.full(travelled.shape, math.inf)
    beams = numpy.flatnonzero(travelled < ends)
    while beams.size:
        along = directions[:, beams]
        places = starts[:, beams] + travelled[beams] * along
        cells = numpy.floor(places).astype(int)
        rows, columns = numpy.clip(cells, 0, size - 1)
        struck = world.obstacles[rows, columns]
        ranges[beams[struck]] = travelled[beams[struck]]
        # To the next cell; or as far as nothing is round the centre of this one, less half its diagonal.
        to_next = ((cells + (along > 0.0) - places) / along).min(axis=0) + _BEYOND
        travelled[beams] += numpy.maximum(to_next, world.distances[rows, columns] / world.resolution - _HALF_DIAGONAL)
        beams = beams[~struck & (travelled[beams] < ends[beams])]
    return ranges


def _starts_in_one(sensor: Beams, bodies: Outlines) -> bool:
    covers = compiled(loops.covers) or loops.covers
    return bool(covers(sensor.pose.x, sensor.pose.y, sensor.owner, bodies.circles, bodies.segments))


def _cast_on_bodies(sensor: Beams, cos: Floats, sin: Floats, bodies: Outlines, ranges: Floats) -> None:
    """Shorten ranges to those at which beams meet bodies, none of which the sensor is in."""
    x, y = sensor.pose.x, sensor.pose.y
    circles = bodies.circles[bodies.circles[:, 3] != sensor.owner]
    dx, dy, radius = circles[:, 0] - x, circles[:, 1] - y, circles[:, 2]
    for i in numpy.flatnonzero(numpy.hypot(dx, dy) - radius <= sensor.range_max):
        along = dx[i] * cos + dy[i] * sin
        beside = dx[i] * sin - dy[i] * cos
        chord = radius[i] ** 2 - beside**2
        meets = (chord >= 0.0) & (along > 0.0)
        ranges[meets] = numpy.minimum(ranges[meets], along[meets] - numpy.sqrt(chord[meets]))
    segments = bodies.segments[bodies.segments[:, 4] != sensor.owner]
    for x0, y0, x1, y1, _ in segments:
        ux, uy, wx, wy = x1 - x0, y1 - y0, x0 - x, y0 - y
        across = cos * uy - sin * ux
        with numpy.errstate(divide='ignore', invalid='ignore', over='ignore'):
            distance = (wx * uy - wy * ux) / across
            part = (wx * sin - wy * cos) / across
        meets = (distance >= 0.0) & (part >= -_ROUNDING) & (part <= 1.0 + _ROUNDING)
        ranges[meets] = numpy.minimum(ranges[meets], distance[meets])
