# SPDX-License-Identifier: BSD-3-Clause
"""Plans paths on a costmap: a shortest path over the grid, pulled straight to any angle where that costs no more."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise
from typing import Final

import numpy
from numpy.typing import NDArray
from scipy import sparse
from scipy.sparse import csgraph

from flexbt_sim.errors import NavigationError
from flexbt_sim.world import Pose

from .costmap import INSCRIBED, Costmap, Position, along

NEUTRAL_COST: Final = 50.0
COST_FACTOR: Final = 0.8
"""Crossing a cell costs 50 + 0.8 * cost, as in Nav2's NavFn."""

SPACING: Final = 0.05
"""Distance between the poses of a path, m."""

END_TOLERANCE: Final = 0.3
"""How far start and goal may be from a free cell, m: a robot that touches a wall has to get away from it."""

_DIRECTIONS: Final = ((0, 1), (1, 0), (1, 1), (1, -1))
_NO_PREDECESSOR: Final = -9999

Cell = tuple[int, int]


class GridPlanner:
    """Plans on one costmap. Building it takes some 50 ms for a flat; planning takes as long."""

    def __init__(self, costmap: Costmap) -> None:
        self._costmap = costmap
        self._free = costmap.costs < INSCRIBED
        self._graph = self._build_graph()

    def plan(self, start: Pose, goal: Pose) -> list[Pose]:
        """A path from start to goal, with the goal's own pose at its end; just this one if they are in one place.

        The robot overlaps no obstacle on its poses and between them. From a start where it does, the path leads
        straight out.

        Raises:
            NavigationError: START_OUTSIDE_MAP, GOAL_OUTSIDE_MAP, START_OCCUPIED, GOAL_OCCUPIED or NO_VALID_PATH.
        """
        begin, end = self._position('START', start), self._position('GOAL', goal)
        target = None if self._costmap.in_collision(goal) else self._anchor(end, goal)
        if target is None:
            raise NavigationError(
                'GOAL_OCCUPIED', f'the goal ({goal.x:.2f}, {goal.y:.2f}) is in collision with an obstacle'
            )
        source = self._anchor(begin, start) if self._costmap.world.clearance(start.x, start.y) > 0.0 else None
        if source is None:
            raise NavigationError('START_OCCUPIED', f'the start ({start.x:.2f}, {start.y:.2f}) is in an obstacle')
        cells = self._search(source, target, goal)
        corners = self._pull_straight([begin, *((row + 0.5, column + 0.5) for row, column in cells), end], cells)
        points = [self._costmap.world.point(row - 0.5, column - 0.5) for row, column in corners]
        return _resample([(start.x, start.y), *points[1:-1], (goal.x, goal.y)], goal)

    def _position(self, which: str, pose: Pose) -> Position:
        world = self._costmap.world
        row, column = world.grid_position(pose.x, pose.y)
        if not (0.0 <= row < world.height and 0.0 <= column < world.width):
            raise NavigationError(
                f'{which}_OUTSIDE_MAP', f'the {which.lower()} ({pose.x:.2f}, {pose.y:.2f}) is outside of the map'
            )
        return row, column

    def _anchor(self, position: Position, pose: Pose) -> Cell | None:
        """The nearest free cell that the robot can get to straight, without coming nearer to an obstacle than it is."""
        world = self._costmap.world
        radius = min(self._costmap.inflation.robot_radius, world.clearance(pose.x, pose.y)) - 1e-6
        reach = math.ceil(END_TOLERANCE / world.resolution)
        bottom, left = (max(0, math.floor(value) - reach) for value in position)
        top, right = (math.floor(value) + reach + 1 for value in position)
        cells = numpy.add(numpy.argwhere(self._free[bottom:top, left:right]), (bottom, left))
        nearest_first = numpy.argsort(((cells + 0.5 - position) ** 2).sum(axis=1))
        for row, column in cells[nearest_first].tolist():
            way, _ = along(position, (row + 0.5, column + 0.5))
            if all(world.is_free(*world.point(*(place - 0.5)), radius) for place in way.T):
                return row, column
        return None

    def _search(self, source: Cell, target: Cell, goal: Pose) -> list[Cell]:
        shape = self._free.shape
        node, last = (int(numpy.ravel_multi_index(cell, shape)) for cell in (source, target))
        # From the goal, so that the predecessors lead from the start to it.
        _, predecessors = csgraph.dijkstra(self._graph, indices=last, return_predecessors=True)
        if node != last and predecessors[node] == _NO_PREDECESSOR:
            raise NavigationError('NO_VALID_PATH', f'no way leads to the goal ({goal.x:.2f}, {goal.y:.2f})')
        cells = [source]
        while node != last:
            node = int(predecessors[node])
            cells.append(divmod(node, shape[1]))
        return cells

    def _pull_straight(self, way: Sequence[Position], cells: Sequence[Cell]) -> list[Position]:
        """Corners of a path that takes straight lines where they are free and cost no more than the cells do.

        ``way`` leads from the start over the ``cells`` to the goal.
        """
        costs = NEUTRAL_COST + COST_FACTOR * numpy.array(
            [self._costmap.costs[cell] for cell in (cells[0], *cells, cells[-1])], float
        )
        steps = numpy.array([math.dist(a, b) for a, b in pairwise(way)])
        spent = numpy.concatenate([[0.0], numpy.cumsum(steps * (costs[:-1] + costs[1:]) / 2.0)])
        corners = [way[0]]
        here, last = 0, len(way) - 1
        while here < last:
            reach = 1
            while here + reach < last and self._is_shortcut(way, spent, here, min(last, here + 2 * reach)):
                reach *= 2
            low, high = min(last, here + reach), min(last, here + 2 * reach)
            while low < high:
                middle = (low + high + 1) // 2
                if self._is_shortcut(way, spent, here, middle):
                    low = middle
                else:
                    high = middle - 1
            here = low
            corners.append(way[here])
        return corners

    def _is_shortcut(self, way: Sequence[Position], spent: NDArray[numpy.float64], i: int, j: int) -> bool:
        mean = NEUTRAL_COST + COST_FACTOR * self._costmap.mean_cost(way[i], way[j])
        return math.dist(way[i], way[j]) * mean <= float(spent[j] - spent[i]) * 1.001 and self._costmap.is_clear(
            way[i], way[j], self._costmap.inflation.robot_radius
        )

    def _build_graph(self) -> sparse.csr_matrix:
        """Costs of the steps between neighbouring free cells.

        A straight step never passes an obstacle nearer than it is at its ends, and a diagonal one than it is at its
        ends or in the middle, at the common corner: obstacles are whole cells.
        """
        height, width = self._free.shape
        numbers = numpy.arange(height * width, dtype=numpy.int32).reshape(height, width)
        weights = (NEUTRAL_COST + COST_FACTOR * self._costmap.costs) / 2.0
        corners = self._costmap.world.half_cell_distances[2:-2:2, 2:-2:2] >= self._costmap.inflation.robot_radius
        rows, columns, lengths = [], [], []
        for up, right in _DIRECTIONS:
            a = (slice(0, height - up), slice(max(0, -right), width - max(0, right)))
            b = (slice(up, height), slice(max(0, right), width + min(0, right)))
            steps = self._free[a] & self._free[b]
            if up and right:
                steps &= corners
            length = (math.hypot(up, right) * (weights[a] + weights[b]))[steps]
            rows += [numbers[a][steps], numbers[b][steps]]
            columns += [numbers[b][steps], numbers[a][steps]]
            lengths += [length, length]
        size = height * width
        entries = (numpy.concatenate(lengths), (numpy.concatenate(rows), numpy.concatenate(columns)))
        return sparse.csr_matrix(entries, shape=(size, size))


def _resample(corners: Sequence[tuple[float, float]], goal: Pose) -> list[Pose]:
    """Poses along straight lines between corners, each heading to the next; the last is the goal."""
    points = []
    for start, end in pairwise(corners):
        count = math.ceil(math.dist(start, end) / SPACING)
        points += [
            (start[0] + (end[0] - start[0]) * i / count, start[1] + (end[1] - start[1]) * i / count)
            for i in range(count)
        ]
    points.append(corners[-1])
    poses = [Pose(x, y, math.atan2(ahead[1] - y, ahead[0] - x)) for (x, y), ahead in pairwise(points)]
    return [*poses, goal]
