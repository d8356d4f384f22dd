# SPDX-License-Identifier: BSD-3-Clause
"""Path planning on a costmap: a cheapest path over the grid, pulled straight to any angle where that costs no
more."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from itertools import pairwise
from typing import Final

import numpy
from numpy.typing import NDArray

from flexbt_navigation.costmaps.costmap import INSCRIBED, LETHAL, Costmap, Position
from flexbt_navigation.costmaps.kernels import Costs, neighbours, search
from flexbt_navigation.errors import NavigationError
from flexbt_sim.world.plane.geometry import Pose

NEUTRAL_COST: Final = 50.0
COST_FACTOR: Final = 0.8
"""Crossing a cell costs 50 + 0.8 * cost, as in Nav2's NavFn."""

SPACING: Final = 0.05
"""Distance between the poses of a path, m."""

END_TOLERANCE: Final = 0.3
"""Maximum distance of start and goal from a free cell, m: a robot that touches a wall has to get away from it."""

SPARE: Final = 0.01
"""Additional distance of a straight line from obstacles, m, so that small deviations of the follower do not matter. It
is at most half of that of the cells that it replaces."""

WEIGHTS: Final = numpy.where(numpy.arange(256) < INSCRIBED, NEUTRAL_COST + COST_FACTOR * numpy.arange(256), math.inf)
"""Cost of crossing a cell, by its cost; infinite where the robot cannot be."""

Cell = tuple[int, int]


class PlanningStopped(NavigationError):
    """The plan is not wanted any more."""


class StopFlag:
    """A flag that ends a plan that is being made on another thread."""

    def __init__(self) -> None:
        self.cell: Costs = numpy.zeros(1, numpy.uint8)

    def set(self) -> None:
        """From any thread."""
        self.cell[0] = 1

    def check(self) -> None:
        """Raise PlanningStopped once it is set."""
        if self.cell[0]:
            raise PlanningStopped('UNKNOWN', 'the plan is not wanted any more')


class GridPlanner:
    """A planner on one costmap."""

    def __init__(self, costmap: Costmap, tolerance: float = 0.0) -> None:
        """``tolerance`` in m: instead of a goal that is occupied, or to which there is no way, the path ends at the
        nearest cell that can be reached within a square of it, with the heading of the goal.
        """
        self._costmap = costmap
        self._tolerance = tolerance

    def plan_through(
        self,
        start: Pose,
        goals: Sequence[Pose],
        stop: StopFlag | None = None,
        before: Sequence[Sequence[Pose]] = (),
    ) -> list[list[Pose]]:
        """Return the legs of a path from goal to goal; each begins where the one before it ends. Raises as
        :meth:`plan`.

        ``before`` is for the first one: the others begin at a goal, and not where the robot is.
        """
        legs: list[list[Pose]] = []
        for goal in goals:
            legs.append(self.plan(legs[-1][-1], goal, stop) if legs else self.plan(start, goal, stop, before))
        return legs

    def plan(
        self,
        start: Pose,
        goal: Pose,
        stop: StopFlag | None = None,
        before: Sequence[Sequence[Pose]] = (),
    ) -> list[Pose]:
        """Return a path from start to goal, with the goal's own pose at its end; just this one if they are in one
        place.

        The robot overlaps no obstacle on its poses and between them. From a start where it does, the path leads
        straight out. ``before`` are paths that the robot may be on, for planners to which that matters.

        Raises:
            NavigationError: START_OUTSIDE_MAP, GOAL_OUTSIDE_MAP, START_OCCUPIED, GOAL_OCCUPIED or NO_VALID_PATH.
            PlanningStopped: ``stop`` was set.
        """
        stop = stop or StopFlag()
        stop.check()
        costmap = self._costmap
        begin, end = self._position('START', start), self._position('GOAL', goal)
        target = None if costmap.in_collision(goal) else self._anchor(end, goal)
        if target is None and not self._tolerance:
            raise self._occupied(goal)
        source = self._anchor(begin, start)
        if source is None:
            raise NavigationError('START_OCCUPIED', f'the start ({start.x:.2f}, {start.y:.2f}) is in an obstacle')
        if target is None or costmap.regions[target] != costmap.regions[source]:
            reason = NavigationError('NO_VALID_PATH', f'no way leads to the goal ({goal.x:.2f}, {goal.y:.2f})')
            near = self._nearest_reachable(end, source, goal.yaw)
            if near is None:
                raise reason if target is not None else self._occupied(goal)
            target, goal = near, Pose(*costmap.world.point(*near), goal.yaw)
        return self._way(start, source, goal, target, stop, before)

    def _way(
        self,
        start: Pose,
        source: Cell,
        goal: Pose,
        target: Cell,
        stop: StopFlag,
        before: Sequence[Sequence[Pose]],
    ) -> list[Pose]:
        """Return a path, where one over cells leads from the one near the start to the one near the goal."""
        cells = self._search(source, target, stop).tolist()
        begin, end = (self._costmap.world.grid_position(*pose[:2]) for pose in (start, goal))
        way = [begin, *((row + 0.5, column + 0.5) for row, column in cells), end]
        return self._along(start, self._pull_straight(way, stop), goal)

    def _along(self, start: Pose, corners: Sequence[Position], goal: Pose) -> list[Pose]:
        """Return a path with corners at these positions; the first and the last are those of start and goal."""
        points = [self._costmap.world.point(row - 0.5, column - 0.5) for row, column in corners]
        return _resample([(start.x, start.y), *points[1:-1], (goal.x, goal.y)], goal)

    def _occupied(self, goal: Pose) -> NavigationError:
        """Return what the map has there stays; what was seen there may go away, and trees wait for that and try
        again."""
        place = f'the goal ({goal.x:.2f}, {goal.y:.2f})'
        if not self._costmap.touches_map(goal):
            return NavigationError('NO_VALID_PATH', f'{place} is covered by an obstacle that is seen there')
        return NavigationError('GOAL_OCCUPIED', f'{place} is in collision with an obstacle')

    def _position(self, which: str, pose: Pose) -> Position:
        world = self._costmap.world
        row, column = world.grid_position(pose.x, pose.y)
        if not (0.0 <= row < world.height and 0.0 <= column < world.width):
            raise NavigationError(
                f'{which}_OUTSIDE_MAP', f'the {which.lower()} ({pose.x:.2f}, {pose.y:.2f}) is outside of the map'
            )
        return row, column

    def _anchor(self, position: Position, pose: Pose) -> Cell | None:
        """Return the nearest free cell that the robot can get to straight, without coming nearer to an obstacle than it
        is.

        There is none for a robot whose centre is in an obstacle.
        """
        costmap = self._costmap
        world = costmap.world
        radius = costmap.inflation.robot_radius
        radius = min(radius, costmap.clearance(pose.x, pose.y, radius))
        if radius == 0.0:
            return None
        for row, column in self._nearest_first(position, END_TOLERANCE):
            centre = (row + 0.5, column + 0.5)
            way = numpy.linspace(position, centre, math.ceil(2.0 * math.dist(position, centre)) + 1)
            if all(costmap.is_free(*world.point(*place), radius - 1e-6) for place in way - 0.5):
                return row, column
        return None

    def _nearest_reachable(self, position: Position, source: Cell, yaw: float) -> Cell | None:
        """Return the nearest cell to which there is a way, and where the robot fits with a heading, within the
        tolerance."""
        costmap, regions = self._costmap, self._costmap.regions
        near = self._nearest_first(position, self._tolerance) if self._tolerance else []
        return next(
            (
                cell
                for cell in near
                if regions[cell] == regions[source] and not costmap.in_collision(Pose(*costmap.world.point(*cell), yaw))
            ),
            None,
        )

    def _nearest_first(self, position: Position, distance: float) -> list[Cell]:
        """Return the free cells of a square round a position, ``distance`` in m to each side."""
        reach = math.ceil(distance / self._costmap.world.resolution)
        bottom, left = (max(0, math.floor(value) - reach) for value in position)
        top, right = (math.floor(value) + reach + 1 for value in position)
        cells = numpy.add(numpy.argwhere(self._costmap.costs[bottom:top, left:right] < INSCRIBED), (bottom, left))
        nearest_first = numpy.argsort(((cells + 0.5 - position) ** 2).sum(axis=1), kind='stable')
        return [(row, column) for row, column in cells[nearest_first].tolist()]

    def _search(self, source: Cell, target: Cell, stop: StopFlag) -> NDArray[numpy.int64]:
        """Return the cells of a cheapest way, shape (n, 2)."""
        costs = numpy.pad(self._costmap.costs, 1, constant_values=LETHAL)
        width = costs.shape[1]
        start, last = ((row + 1) * width + column + 1 for row, column in (source, target))
        directions, _ = search(costs, WEIGHTS, start, last, stop.cell)
        stop.check()
        steps = neighbours(width)
        way = [last]
        while way[-1] != start:
            way.append(way[-1] - steps[directions[way[-1]]])
        return numpy.stack(numpy.divmod(way[::-1], width), axis=1) - 1

    def _pull_straight(
        self, way: Sequence[Position], stop: StopFlag, fits: Callable[[int, int], bool] = lambda _here, _there: True
    ) -> list[Position]:
        """Corners of a way, which leads from cell to cell but for its ends, that takes straight lines where they are
        free and cost no more than what is between, and where a line from one to another place on the way ``fits``.
        """
        if len(way) < 3:
            return list(way)
        cells = numpy.floor(way[1:-1]).astype(int)
        weights = WEIGHTS[self._costmap.costs[cells[:, 0], cells[:, 1]]]
        weights = numpy.concatenate([weights[:1], weights, weights[-1:]])
        radii = self._radii(way[0], cells, way[-1])
        steps = numpy.hypot(*numpy.diff(way, axis=0).T)
        spent = numpy.concatenate([[0.0], numpy.cumsum(steps * (weights[:-1] + weights[1:]) / 2.0)])

        def is_shortcut(i: int, j: int) -> bool:
            mean = NEUTRAL_COST + COST_FACTOR * self._costmap.mean_cost(way[i], way[j])
            cheap = math.dist(way[i], way[j]) * mean <= float(spent[j] - spent[i]) * 1.001
            return cheap and self._costmap.is_clear(way[i], way[j], float(radii[i : j + 1].min())) and fits(i, j)

        corners = [way[0]]
        here, last = 0, len(way) - 1
        while here < last:
            stop.check()
            reach = 1
            while here + reach < last and is_shortcut(here, min(last, here + 2 * reach)):
                reach *= 2
            low, high = min(last, here + reach), min(last, here + 2 * reach)
            while low < high:
                middle = (low + high + 1) // 2
                if is_shortcut(here, middle):
                    low = middle
                else:
                    high = middle - 1
            here = low
            corners.append(way[here])
        return corners

    def _radii(self, begin: Position, cells: NDArray[numpy.int64], end: Position) -> NDArray[numpy.float64]:
        """Of the circles, m, that a straight line past these places has room for: the robot's, and what is to spare."""
        world, radius = self._costmap.world, self._costmap.inflation.robot_radius
        first, last = (
            self._costmap.clearance(*world.point(row - 0.5, column - 0.5), radius + 2.0 * SPARE)
            for row, column in (begin, end)
        )
        between = numpy.sqrt(self._costmap.squares[cells[:, 0], cells[:, 1]]) * (world.resolution / 2.0)
        room = numpy.concatenate([[first], between, [last]])
        radii: NDArray[numpy.float64] = radius + numpy.clip((room - radius) / 2.0, 0.0, SPARE)
        return radii


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
