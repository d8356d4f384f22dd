# SPDX-License-Identifier: BSD-3-Clause
"""Straight lines between places: what is on them, and where they are nearest to a place."""

from __future__ import annotations

import math
from typing import Final

import numpy
from numpy.typing import NDArray

from flexbt_navigation.costmaps.costmap import Costmap
from flexbt_sim.world.plane.geometry import Point

CELLS_AT_A_TIME: Final = 1_000_000
"""Number of cells at a time; more take as long, and more memory."""


def line_costs(costmap: Costmap, start: Point, end: Point) -> tuple[NDArray[numpy.uint8], bool]:
    """Costs of the cells on a line, as far as they are on the map (at least one: 0), and whether all of them are."""
    world = costmap.world
    ends = numpy.array([world.grid_position(*start), world.grid_position(*end)])
    count = max(1, math.ceil(2.0 * float(numpy.hypot(*(ends[1] - ends[0])))))
    rows, columns = numpy.floor(numpy.linspace(ends[0], ends[1], count + 1)).astype(int).T
    inside = (rows >= 0) & (rows < world.height) & (columns >= 0) & (columns < world.width)
    costs = costmap.costs[rows[inside], columns[inside]]
    return (costs if costs.size else numpy.zeros(1, numpy.uint8)), bool(inside.all())


def greatest_costs(
    costmap: Costmap, starts: NDArray[numpy.float64], ends: NDArray[numpy.float64]
) -> tuple[NDArray[numpy.float64], NDArray[numpy.bool_]]:
    """Return the greatest cost of each of many lines, N x 2, m (:func:`line_costs`), and whether it is on the map."""
    world = costmap.world
    begin, end = (numpy.stack(world.grid_position(*points.T), axis=1) for points in (starts, ends))
    counts = numpy.maximum(1, numpy.ceil(2.0 * numpy.hypot(*(end - begin).T))).astype(int)
    greatest, is_on_map = numpy.zeros(len(counts)), numpy.ones(len(counts), bool)
    pieces = numpy.flatnonzero(numpy.diff(numpy.cumsum(counts + 1) // CELLS_AT_A_TIME)) + 1
    for lines in numpy.split(numpy.arange(len(counts)), pieces):
        points = counts[lines] + 1
        last = numpy.cumsum(points) - 1
        first = last - counts[lines]
        steps = numpy.arange(points.sum()) - numpy.repeat(first, points)
        places = numpy.repeat(begin[lines], points, axis=0)
        places += steps[:, None] * numpy.repeat((end[lines] - begin[lines]) / counts[lines, None], points, axis=0)
        places[last] = end[lines]
        rows, columns = numpy.floor(places).astype(int).T
        inside = (rows >= 0) & (rows < world.height) & (columns >= 0) & (columns < world.width)
        costs = numpy.zeros(len(rows), numpy.uint8)
        costs[inside] = costmap.costs[rows[inside], columns[inside]]
        greatest[lines] = numpy.maximum.reduceat(costs, first)
        is_on_map[lines] = numpy.logical_and.reduceat(inside, first)
    return greatest, is_on_map


def closest_point(place: Point, start: Point, end: Point) -> Point:
    """Return the point of the line from start to end that is closest to a place."""
    dx, dy = end[0] - start[0], end[1] - start[1]
    square = dx * dx + dy * dy
    part = ((place[0] - start[0]) * dx + (place[1] - start[1]) * dy) / square if square else 0.0
    part = min(1.0, max(0.0, part))
    return start[0] + part * dx, start[1] + part * dy


def cosine(ax: float, ay: float, bx: float, by: float) -> float:
    """Return the cosine of the angle between two vectors; 0 if one of them has no direction."""
    lengths = math.hypot(ax, ay) * math.hypot(bx, by)
    return (ax * bx + ay * by) / lengths if lengths > 1e-12 else 0.0
