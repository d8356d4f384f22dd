# SPDX-License-Identifier: BSD-3-Clause
"""The inner loops over the cells of a costmap, written so that numba can compile them.

Squared gaps are in half cells. A gap is the distance from the centre of a cell to the nearest point of an obstacle
cell. Along an axis it is an odd number of half cells, or 0 in the obstacle itself.
"""

from __future__ import annotations

import math
from functools import partial
from typing import Any

import numpy
from numpy.typing import NDArray

from flexbt_sim.world.plane.loops import Loop

Bools = NDArray[numpy.bool_]
Costs = NDArray[numpy.uint8]
Squares = NDArray[numpy.int32]
Weights = NDArray[numpy.float64]


def neighbours(width: int) -> tuple[int, ...]:
    """Return the offsets from the number of a cell to those of its eight neighbours, in a grid of this width; diagonals
    last."""
    return 1, width, -1, -width, width + 1, width - 1, -width - 1, -width + 1


def squared_gaps_at_once(obstacles: Bools, bottom: int, top: int, left: int, right: int, reach: int) -> Squares:
    """Return the same as :func:`squared_gaps`, without numba: interpreted, that takes 260 times as long, on the
    executor."""
    height, width = obstacles.shape
    far = 4 * reach * reach + 1
    low, first = max(0, bottom - reach), max(0, left - reach)
    part = obstacles[low : min(height, top + reach), first : min(width, right + reach)]
    rows = numpy.arange(part.shape[0], dtype=numpy.int32)[:, None]
    below = numpy.maximum.accumulate(numpy.where(part, rows, -reach - 1), axis=0)
    above = numpy.minimum.accumulate(numpy.where(part, rows, part.shape[0] + reach)[::-1], axis=0)[::-1]
    gaps = numpy.minimum(numpy.minimum(rows - below, above - rows), reach + 1)[bottom - low : top - low]
    padded = numpy.full((top - bottom, part.shape[1] + 2 * reach), far, numpy.int32)
    padded[:, reach : reach + part.shape[1]] = numpy.square(numpy.maximum(2 * gaps - 1, 0))
    centre, columns = reach + left - first, right - left
    squares = numpy.minimum(padded[:, centre : centre + columns], far)
    for offset in range(1, reach + 1):
        across = (2 * offset - 1) ** 2
        for begin in (centre - offset, centre + offset):
            numpy.minimum(squares, across + padded[:, begin : begin + columns], out=squares)
    return squares


@partial(Loop, otherwise=squared_gaps_at_once)
def squared_gaps(obstacles: Bools, bottom: int, top: int, left: int, right: int, reach: int) -> Squares:
    """Return the squared gaps of the cells in a box, up to ``reach`` cells; (2 * reach)² + 1 where no obstacle is that
    near."""
    height, width = obstacles.shape
    far = 4 * reach * reach + 1
    first, last = max(0, left - reach), min(width, right + reach)
    gaps = numpy.empty((top - bottom, last - first), numpy.int32)
    # Up and down each column: the number of rows since the last obstacle.
    ago = numpy.full(last - first, reach + 1, numpy.int32)
    for row in range(max(0, bottom - reach), top):
        for i in range(last - first):
            ago[i] = 0 if obstacles[row, first + i] else ago[i] + 1
        if row >= bottom:
            for i in range(last - first):
                gaps[row - bottom, i] = ago[i]
    ago[:] = reach + 1
    for row in range(min(height, top + reach) - 1, bottom - 1, -1):
        for i in range(last - first):
            ago[i] = 0 if obstacles[row, first + i] else ago[i] + 1
        if row < top:
            for i in range(last - first):
                gaps[row - bottom, i] = min(gaps[row - bottom, i], ago[i])
    squares = numpy.empty((top - bottom, right - left), numpy.int32)
    columns = numpy.empty(last - first, numpy.int32)
    after = numpy.empty(last - first, numpy.int32)
    for row in range(top - bottom):
        following = last - first + reach + 1
        for i in range(last - first - 1, -1, -1):
            gap = gaps[row, i]
            columns[i] = 0 if gap == 0 else (2 * gap - 1) * (2 * gap - 1)
            if gap <= reach:
                following = i
            after[i] = following
        before = -reach - 1
        for i in range(last - first):
            if gaps[row, i] <= reach:
                before = i
            if left <= first + i < right:
                best = min(far, columns[i])
                # No obstacle is nearer than the nearest columns that have one.
                for offset in range(max(1, min(i - before, after[i] - i)), reach + 1):
                    across = (2 * offset - 1) * (2 * offset - 1)
                    if across >= best:
                        break
                    if i - offset >= 0:
                        best = min(best, across + columns[i - offset])
                    if i + offset < last - first:
                        best = min(best, across + columns[i + offset])
                squares[row, first + i - left] = best
    return squares


@Loop
def search(
    costs: Costs, weights: Weights, start: int, goal: int, stop: Costs
) -> tuple[NDArray[numpy.int8], NDArray[numpy.float32]]:
    """Return, for each cell, the direction (index into :func:`neighbours`) in which the cheapest path from the start
    enters it, -1 for none, and the cost of that path, infinite without one. If the goal cannot be reached, these are
    the values of all cells.

    This is A* over neighbouring free cells. A step costs its length in cells times the mean of the ``weights`` of the
    costs of its ends. Cells of infinite weight are not free, and a diagonal between two cells is free if all four are.
    All cells at the border have infinite weight. Cells are numbered row by row. If another thread sets ``stop[0]``, the
    search ends and returns what it has found so far.

    The queue is a ring of buckets, each a linked list. A bucket is not sorted, so a cell may be examined twice. The
    search ends when no queued cell is cheaper than the path to the goal.
    """
    width = costs.shape[1]
    flat = costs.reshape(costs.size)
    steps = (1, width, -1, -width, width + 1, width - 1, -width - 1, -width + 1)
    least = most = weights[0]
    for weight in weights:
        if weight < math.inf:
            least, most = min(least, weight), max(most, weight)
    diagonal = math.sqrt(2.0)
    bucket_width = least / 2.0
    buckets = int(diagonal * (most + least) / bucket_width) + 3
    first = numpy.full(buckets, -1, numpy.int32)
    # An entry of the queue: the cell, and the next entry. Entries are reused once they were examined.
    cells = numpy.empty(4096, numpy.int32)
    following = numpy.empty(4096, numpy.int32)
    unused, used = -1, 1
    spent = numpy.full(costs.size, math.inf, numpy.float32)
    directions = numpy.full(costs.size, -1, numpy.int8)
    is_open = numpy.zeros(costs.size, numpy.uint8)
    goal_row, goal_column = goal // width, goal % width
    dr, dc = abs(start // width - goal_row), abs(start % width - goal_column)
    current = int(least * (max(dr, dc) + (diagonal - 1.0) * min(dr, dc)) / bucket_width)
    cells[0], following[0] = start, -1
    first[current % buckets] = 0
    spent[start] = 0.0
    is_open[start] = 1
    waiting, looked = 1, 0
    beside = numpy.empty(4, numpy.float64)
    while waiting > 0 and current * bucket_width <= spent[goal]:
        slot = current % buckets
        entry = first[slot]
        if entry < 0:
            current += 1
            continue
        first[slot] = following[entry]
        following[entry] = unused
        unused = entry
        waiting -= 1
        cell = cells[entry]
        if not is_open[cell]:
            continue
        is_open[cell] = 0
        looked += 1
        if looked % 4096 == 0 and stop[0]:
            break
        here, weight = spent[cell], weights[flat[cell]]
        for way in range(8):
            other = cell + steps[way]
            there = weights[flat[other]]
            if way < 4:
                beside[way] = there
            if there == math.inf:
                continue
            step = (weight + there) / 2.0
            if way >= 4:
                if beside[way - 4] == math.inf or beside[(way - 3) % 4] == math.inf:
                    continue
                step *= diagonal
            cost = numpy.float32(here + step)
            if cost >= spent[other]:
                continue
            spent[other] = cost
            directions[other] = way
            is_open[other] = 1
            dr = abs(other // width - goal_row)
            dc = abs(other % width - goal_column)
            ahead = least * (max(dr, dc) + (diagonal - 1.0) * min(dr, dc))
            slot = max(current, int((cost + ahead) / bucket_width)) % buckets
            if unused >= 0:
                entry = unused
                unused = following[entry]
            else:
                if used == cells.size:
                    cells = numpy.concatenate((cells, numpy.empty(used, numpy.int32)))
                    following = numpy.concatenate((following, numpy.empty(used, numpy.int32)))
                entry = used
                used += 1
            cells[entry], following[entry] = other, first[slot]
            first[slot] = entry
            waiting += 1
    return directions, spent


@Loop
def is_clear(
    obstacles: Bools, squares: Squares, start: tuple[float, float], end: tuple[float, float], radius: float
) -> Any:
    """Return whether a circle can move on a straight line from one position to another; all in cells.

    The result is never wrongly true; it may be wrongly false where there is hardly any room to spare. The error between
    two samples is bounded by the square of their spacing, since the square of the distance from a point has the
    constant curvature 2.
    """
    height, width = obstacles.shape
    length = math.hypot(end[0] - start[0], end[1] - start[1])
    intervals = max(1, math.ceil(4.0 * length))
    needed = math.sqrt(radius * radius + (length / intervals / 2.0) ** 2)
    for i in range(intervals + 1):
        row = start[0] + (end[0] - start[0]) * i / intervals
        column = start[1] + (end[1] - start[1]) * i / intervals
        r = min(max(math.floor(row), 0), height - 1)
        c = min(max(math.floor(column), 0), width - 1)
        known = math.sqrt(squares[r, c]) / 2.0
        if known - math.hypot(row - r - 0.5, column - c - 0.5) >= needed:
            continue
        for a in range(max(0, int(row - needed) - 1), min(height, int(row + needed) + 2)):
            up = max(a - row, row - a - 1.0, 0.0)
            for b in range(max(0, int(column - needed) - 1), min(width, int(column + needed) + 2)):
                if obstacles[a, b]:
                    right = max(b - column, column - b - 1.0, 0.0)
                    if up * up + right * right < needed * needed:
                        return False
    return True


@Loop
def mean_cost(costs: Costs, start: tuple[float, float], end: tuple[float, float]) -> Any:
    """Return the mean cost of the cells along a straight line between two positions, in cells."""
    height, width = costs.shape
    samples = max(1, math.ceil(8.0 * math.hypot(end[0] - start[0], end[1] - start[1])))
    total = 0
    for i in range(samples):
        part = (i + 0.5) / samples
        row = int(start[0] + (end[0] - start[0]) * part)
        column = int(start[1] + (end[1] - start[1]) * part)
        total += int(costs[min(max(row, 0), height - 1), min(max(column, 0), width - 1)])
    return total / samples


@Loop
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
    """Clear the marks along beams, then mark the cells where they hit; all in cells.

    The beams start at (row, column). ``directions``, shape (n, 2), are unit steps up and to the right. ``cleared`` is
    the free length of each beam, ``struck`` the distance of its hit, negative for none. A hit within ``tolerance`` of a
    known obstacle is attributed to it and not marked.
    """
    height, width = marks.shape
    for beam in range(len(directions)):
        up, right = directions[beam, 0], directions[beam, 1]
        for step in range(math.floor(2.0 * cleared[beam]) + 1):
            r, c = math.floor(row + up * step / 2.0), math.floor(column + right * step / 2.0)
            if 0 <= r < height and 0 <= c < width:
                marks[r, c] = False
    reach = math.ceil(tolerance)
    for beam in range(len(directions)):
        if struck[beam] < 0.0:
            continue
        at_row, at_column = row + directions[beam, 0] * struck[beam], column + directions[beam, 1] * struck[beam]
        r, c = math.floor(at_row), math.floor(at_column)
        if not (0 <= r < height and 0 <= c < width):
            continue
        known = False
        for a in range(max(0, r - reach), min(height, r + reach + 1)):
            for b in range(max(0, c - reach), min(width, c + reach + 1)):
                if obstacles[a, b]:
                    above = max(a - at_row, at_row - a - 1.0, 0.0)
                    beside = max(b - at_column, at_column - b - 1.0, 0.0)
                    known = known or above * above + beside * beside <= tolerance * tolerance
        if not known:
            marks[r, c] = True
