# SPDX-License-Identifier: BSD-3-Clause
"""The functions of ``costmaps.kernels`` by operations on whole arrays, which these are tested against."""

from __future__ import annotations

import math
from typing import Final

import numpy
from numpy.typing import NDArray

from flexbt_navigation.costmaps.kernels import Bools, Costs, Squares, Weights, neighbours

_STRIDE: Final = 6.0


def search(
    costs: Costs, weights: Weights, start: int, goal: int, stop: Costs
) -> tuple[NDArray[numpy.int8], NDArray[numpy.float32]]:
    """Do as ``kernels.search``. Looks at many cells at once: those on ways up to some cost, until none of these
    becomes cheaper, then those on ways that cost up to ``_STRIDE`` free cells more.
    """
    width = costs.shape[1]
    flat = costs.reshape(costs.size)
    steps, halves = numpy.array(neighbours(width)), numpy.repeat([0.5, math.sqrt(0.5)], 4)
    least = weights[weights < math.inf].min()
    spent = numpy.full(costs.size, math.inf, numpy.float32)
    directions = numpy.full(costs.size, -1, numpy.int8)

    def through(cells: NDArray[numpy.int64]) -> Weights:
        """Costs of the ways to the goal through cells, at least."""
        rows, columns = numpy.abs(cells // width - goal // width), numpy.abs(cells % width - goal % width)
        octile = numpy.maximum(rows, columns) + (math.sqrt(2.0) - 1.0) * numpy.minimum(rows, columns)
        ways: Weights = spent[cells] + least * octile
        return ways

    spent[start] = 0.0
    near = numpy.array([start])
    limit, later = through(near)[0], [near[:0]]
    while near.size:
        others = near[:, None] + steps
        there = weights[flat[others]]
        blocked = numpy.isinf(there[:, :4])
        there[:, 4:][blocked | numpy.roll(blocked, -1, axis=1)] = math.inf
        reached = (spent[near, None] + (weights[flat[near], None] + there) * halves).astype(numpy.float32)
        better = reached < spent[others]
        cells, reached, ways = others[better], reached[better], numpy.nonzero(better)[1]
        numpy.minimum.at(spent, cells, reached)
        shortest = spent[cells] == reached
        cells = cells[shortest]
        directions[cells] = ways[shortest]
        if stop[0]:
            break
        costs_through = through(cells)
        later.append(cells[costs_through > limit])
        near = numpy.unique(cells[costs_through <= limit])
        if not near.size:
            cells = numpy.concatenate(later)
            costs_through = through(cells)
            waiting = (costs_through > limit) & (costs_through <= spent[goal])
            cells, costs_through = cells[waiting], costs_through[waiting]
            limit = costs_through.min(initial=math.inf) + _STRIDE * least
            near, later = numpy.unique(cells[costs_through <= limit]), [cells[costs_through > limit]]
    return directions, spent


def is_clear(
    obstacles: Bools, squares: Squares, start: tuple[float, float], end: tuple[float, float], radius: float
) -> bool:
    """Do as ``kernels.is_clear``."""
    height, width = obstacles.shape
    length = math.dist(start, end)
    intervals = max(1, math.ceil(4.0 * length))
    needed = math.sqrt(radius * radius + (length / intervals / 2.0) ** 2)
    points = numpy.linspace(start, end, intervals + 1)
    cells = numpy.clip(numpy.floor(points).astype(int), 0, (height - 1, width - 1))
    known = numpy.sqrt(squares[cells[:, 0], cells[:, 1]]) / 2.0
    for row, column in points[known - numpy.hypot(*(points - cells - 0.5).T) < needed].tolist():
        bottom, left = max(0, int(row - needed) - 1), max(0, int(column - needed) - 1)
        near = obstacles[bottom : int(row + needed) + 2, left : int(column + needed) + 2]
        rows, columns = numpy.nonzero(near)
        up = numpy.maximum(numpy.maximum(rows + (bottom - row), row - bottom - 1.0 - rows), 0.0)
        right = numpy.maximum(numpy.maximum(columns + (left - column), column - left - 1.0 - columns), 0.0)
        if (up * up + right * right < needed * needed).any():
            return False
    return True


def nearest(obstacles: Bools, known: Bools, only_new: bool, row: float, column: float, reach: float) -> float:
    """Do as ``kernels.nearest``."""
    bottom, left = max(0, math.floor(row - reach)), max(0, math.floor(column - reach))
    part = (slice(bottom, max(0, math.ceil(row + reach))), slice(left, max(0, math.ceil(column + reach))))
    rows, columns = numpy.nonzero(obstacles[part] & ~known[part] if only_new else obstacles[part])
    up = numpy.maximum(numpy.maximum(rows + (bottom - row), row - bottom - 1.0 - rows), 0.0)
    right = numpy.maximum(numpy.maximum(columns + (left - column), column - left - 1.0 - columns), 0.0)
    return math.sqrt((up * up + right * right).min(initial=math.inf))


def mean_cost(costs: Costs, start: tuple[float, float], end: tuple[float, float]) -> float:
    """Do as ``kernels.mean_cost``."""
    samples = max(1, math.ceil(8.0 * math.dist(start, end)))
    parts = ((numpy.arange(samples) + 0.5) / samples)[:, None]
    points = (start + (numpy.array(end) - start) * parts).astype(int)
    rows, columns = numpy.clip(points, 0, (costs.shape[0] - 1, costs.shape[1] - 1)).T
    return float(costs[rows, columns].mean())


def trace(
    marks: Bools,
    obstacles: Bools,
    row: float,
    column: float,
    directions: Weights,
    cleared: Weights,
    struck: Weights,
    tolerance: float,
) -> None:
    """Do as ``kernels.trace``."""
    steps = numpy.arange(math.floor(2.0 * cleared.max(initial=0.0)) + 1) / 2.0
    seen = steps <= cleared[:, None]
    marks[_cells(marks, (row, column) + directions[:, None] * steps[:, None], seen)] = False
    places = (row, column) + directions * struck[:, None]
    known = numpy.zeros(len(places), bool)
    cells = numpy.floor(places).astype(int)
    reach = math.ceil(tolerance)
    for up in range(-reach, reach + 1):
        for right in range(-reach, reach + 1):
            near = numpy.add(cells, (up, right))
            gaps = numpy.maximum(numpy.maximum(near - places, places - near - 1.0), 0.0)
            on_map = ((near >= 0) & (near < marks.shape)).all(axis=1)
            rows, columns = numpy.clip(near, 0, numpy.subtract(marks.shape, 1)).T
            known |= on_map & obstacles[rows, columns] & ((gaps**2).sum(axis=1) <= tolerance * tolerance)
    marks[_cells(marks, places, (struck >= 0.0) & ~known)] = True


def _cells(grid: Bools, places: Weights, chosen: Bools) -> tuple[NDArray[numpy.int64], NDArray[numpy.int64]]:
    """Rows and columns of the cells of a grid in which the chosen places are."""
    cells = numpy.floor(places[chosen]).astype(int)
    rows, columns = cells[((cells >= 0) & (cells < grid.shape)).all(axis=1)].T
    return rows, columns
