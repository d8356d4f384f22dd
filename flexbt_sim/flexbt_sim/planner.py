# SPDX-License-Identifier: BSD-3-Clause
"""Plans paths on a costmap: a shortest path over the grid, pulled straight to any angle where that costs no more."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise
from typing import Final

import numpy
from scipy import sparse
from scipy.sparse import csgraph

from flexbt_sim.costmap import INSCRIBED, Costmap
from flexbt_sim.errors import NavigationError
from flexbt_sim.geometry import Pose

NEUTRAL_COST: Final = 50.0
COST_FACTOR: Final = 0.8
"""Crossing a cell costs 50 + 0.8 * cost, as in Nav2's NavFn."""

SPACING: Final = 0.05
"""Distance between the poses of a path, m."""

START_TOLERANCE: Final = 0.3
"""How far the start may be from a free cell, m: a robot that touches a wall has to get away from it."""

_NEIGHBOURS: Final = ((0, 1), (1, 0), (1, 1), (1, -1))
_NO_PREDECESSOR: Final = -9999

Cell = tuple[int, int]


class GridPlanner:
    """Plans on one costmap. Building it takes some 50 ms for a flat; planning takes as long."""

    def __init__(self, costmap: Costmap) -> None:
        self._costmap = costmap
        self._free = costmap.costs < INSCRIBED
        self._graph = self._build_graph()

    def plan(self, start: Pose, goal: Pose) -> list[Pose]:
        """A path from start to goal, with the goal's own pose at its end.

        Raises:
            NavigationError: START_OUTSIDE_MAP, GOAL_OUTSIDE_MAP, START_OCCUPIED, GOAL_OCCUPIED or NO_VALID_PATH.
        """
        begin, end = self._cell('START', start), self._cell('GOAL', goal)
        if not self._free[end]:
            raise NavigationError(
                'GOAL_OCCUPIED', f'the goal ({goal.x:.2f}, {goal.y:.2f}) is in collision with an obstacle'
            )
        begin = self._nearest_free(begin, start)
        cells = self._search(begin, end, goal)
        corners = [self._costmap.world.point(*cell) for cell in self._pull_straight(cells)]
        corners[0] = (start.x, start.y)
        corners[-1] = (goal.x, goal.y)
        return _resample(corners, goal)

    def _cell(self, which: str, pose: Pose) -> Cell:
        row, column = self._costmap.world.cell(pose.x, pose.y)
        if not self._costmap.world.contains(row, column):
            name = which.lower()
            raise NavigationError(
                f'{which}_OUTSIDE_MAP', f'the {name} ({pose.x:.2f}, {pose.y:.2f}) is outside of the map'
            )
        return row, column

    def _nearest_free(self, cell: Cell, start: Pose) -> Cell:
        if self._free[cell]:
            return cell
        reach = math.ceil(START_TOLERANCE / self._costmap.world.resolution)
        row, column = cell
        top, left = max(0, row - reach), max(0, column - reach)
        rows, columns = numpy.nonzero(self._free[top : row + reach + 1, left : column + reach + 1])
        if not rows.size:
            raise NavigationError('START_OCCUPIED', f'the start ({start.x:.2f}, {start.y:.2f}) is in an obstacle')
        nearest = numpy.argmin((rows + top - row) ** 2 + (columns + left - column) ** 2)
        return int(rows[nearest] + top), int(columns[nearest] + left)

    def _search(self, begin: Cell, end: Cell, goal: Pose) -> list[Cell]:
        width = self._costmap.world.width
        source, target = begin[0] * width + begin[1], end[0] * width + end[1]
        # From the goal, so that the predecessors lead from the start to it.
        _, predecessors = csgraph.dijkstra(self._graph, directed=False, indices=target, return_predecessors=True)
        if source != target and predecessors[source] == _NO_PREDECESSOR:
            raise NavigationError('NO_VALID_PATH', f'no way leads to the goal ({goal.x:.2f}, {goal.y:.2f})')
        node = source
        cells = [begin]
        while node != target:
            node = int(predecessors[node])
            cells.append(divmod(node, width))
        return cells

    def _pull_straight(self, cells: Sequence[Cell]) -> list[Cell]:
        """Corners of a path that takes straight lines where they are free and cost no more than the cells do."""
        costs = NEUTRAL_COST + COST_FACTOR * numpy.array([self._costmap.costs[cell] for cell in cells], float)
        steps = numpy.array([math.dist(a, b) for a, b in pairwise(cells)])
        along = numpy.concatenate([[0.0], numpy.cumsum(steps * (costs[:-1] + costs[1:]) / 2.0)])
        corners = [cells[0]]
        here, last = 0, len(cells) - 1
        while here < last:
            reach = 1
            while here + reach < last and self._is_shortcut(cells, along, here, min(last, here + 2 * reach)):
                reach *= 2
            low, high = min(last, here + reach), min(last, here + 2 * reach)
            while low < high:
                middle = (low + high + 1) // 2
                if self._is_shortcut(cells, along, here, middle):
                    low = middle
                else:
                    high = middle - 1
            here = max(low, here + 1)
            corners.append(cells[here])
        return corners if len(corners) > 1 else [cells[0], cells[-1]]

    def _is_shortcut(self, cells: Sequence[Cell], along: numpy.typing.NDArray[numpy.float64], i: int, j: int) -> bool:
        costs = self._costmap.line_costs(cells[i], cells[j])
        if costs.max() >= INSCRIBED:
            return False
        line = math.dist(cells[i], cells[j]) * float(NEUTRAL_COST + COST_FACTOR * costs.mean())
        return line <= float(along[j] - along[i]) * 1.001

    def _build_graph(self) -> sparse.csr_matrix:
        height, width = self._free.shape
        numbers = numpy.arange(height * width).reshape(height, width)
        weights = NEUTRAL_COST + COST_FACTOR * self._costmap.costs.astype(float)
        rows, columns, lengths = [], [], []
        for dr, dc in _NEIGHBOURS:
            a = (slice(0, height - dr), slice(max(0, -dc), width - max(0, dc)))
            b = (slice(dr, height), slice(max(0, dc), width + min(0, dc)))
            open_edges = self._free[a] & self._free[b]
            if dr and dc:  # no cutting of corners
                open_edges &= self._free[a[0], b[1]] & self._free[b[0], a[1]]
            rows.append(numbers[a][open_edges])
            columns.append(numbers[b][open_edges])
            lengths.append((math.hypot(dr, dc) * (weights[a] + weights[b]) / 2.0)[open_edges])
        size = height * width
        entries = (numpy.concatenate(lengths), (numpy.concatenate(rows), numpy.concatenate(columns)))
        return sparse.csr_matrix(entries, shape=(size, size))


def _resample(corners: Sequence[tuple[float, float]], goal: Pose) -> list[Pose]:
    """Poses along straight lines between corners, each heading to the next; the last is the goal."""
    points = []
    for start, end in pairwise(corners):
        count = max(1, math.ceil(math.dist(start, end) / SPACING))
        points += [
            (start[0] + (end[0] - start[0]) * i / count, start[1] + (end[1] - start[1]) * i / count)
            for i in range(count)
        ]
    points.append(corners[-1])
    poses = [Pose(x, y, math.atan2(ahead[1] - y, ahead[0] - x)) for (x, y), ahead in pairwise(points)]
    return [*poses, goal]
