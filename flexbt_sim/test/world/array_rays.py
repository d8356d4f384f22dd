# SPDX-License-Identifier: BSD-3-Clause
"""Ray casting by operations on whole arrays, which the loops are tested against."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final

import numpy

from flexbt_sim.world import OccupancyMap
from flexbt_sim.world.plane.loops import covers
from flexbt_sim.world.plane.ray_casting import Beams, Floats, Outlines

_BEYOND: Final = 1e-6
"""Distance by which a beam has to enter the next cell to be in it, in cells."""

_ROUNDING: Final = 1e-9
"""Part of a side by which it is longer, so that no beam slips between two sides."""

_HALF_DIAGONAL: Final = 0.71
"""Half the diagonal of a cell, rounded up."""


def cast_at_once(world: OccupancyMap | None, sensors: Sequence[Beams], bodies: Outlines) -> list[Floats]:
    """Return how far each beam gets, m; infinite where it meets nothing within its range."""
    angles = [one.pose.yaw + one.angle_min + numpy.arange(one.beams) * one.angle_increment for one in sensors]
    if world is None:
        found: list[Floats] = [numpy.full(one.beams, math.inf) for one in sensors]
    else:
        found = _cast_on_map(world, sensors, angles)
    for sensor, heading, ranges in zip(sensors, angles, found, strict=True):
        if covers(sensor.pose.x, sensor.pose.y, sensor.owner, *bodies):
            ranges.fill(0.0)
            continue
        _cast_on_bodies(sensor, numpy.cos(heading), numpy.sin(heading), bodies, ranges)
        ranges[ranges > sensor.range_max] = math.inf
    return found


def _cast_on_map(world: OccupancyMap, sensors: Sequence[Beams], angles: Sequence[Floats]) -> list[Floats]:
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
