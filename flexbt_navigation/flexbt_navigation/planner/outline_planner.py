# SPDX-License-Identifier: BSD-3-Clause
"""Path planning for a robot that turns on the spot and is not a circle. Where its outline has no room on the path
of a circle, it searches over places and headings, as Nav2's SmacPlannerLattice with the primitives of this robot.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import cache, cached_property
from itertools import product
from typing import Any, Final

import numpy
from numpy.typing import NDArray

from flexbt_navigation.costmaps.costmap import INSCRIBED, LETHAL, Position
from flexbt_navigation.costmaps.kernels import search
from flexbt_navigation.errors import NavigationError
from flexbt_sim.world.plane.geometry import Pose

from .grid_planner import WEIGHTS, Cell, GridPlanner, StopFlag
from .hybrid_kernels import GridPose, Outline, outline_search, room_along, room_on_way

MOST_DISCS: Final = 20
"""Maximum number of discs by which a robot is checked before its outline is."""

MOST_OUTLINES: Final = (20_000, 150_000, 1_000_000)
"""Maximum number of places and headings that are looked at from either end, by turns, until the search is given up:
five seconds."""

USUAL_REACH: Final = 10.0
"""Reach of a robot, in cells, for which these numbers hold; they are lower for a larger one, as each place takes
longer."""

MOST_INTERPRETED: Final = (1_000, 4_000)
"""The same where nothing is compiled."""

ROUND_OUTLINE: Final = 1.0
"""Room beyond the robot's reach, in cells, at the middle of a cell in which it can turn anywhere."""

OUTLINE_MARGIN: Final = 0.05
"""Distance to obstacles, m, within which the way costs more."""

SAME_PLACE: Final = 1e-6
"""Distance, in cells, that leads nowhere."""

ON_PATH: Final = 0.1
"""Maximum distance from a path at which the robot is still on it, m."""


class OutlinePlanner(GridPlanner):
    """A planner on one costmap for a robot whose footprint is a polygon.

    The plan is that of a circle as large as fits into the footprint, if the outline has room all along it, where the
    robot turns and for the headings of start and goal. Otherwise it is searched for by place and heading, from either
    end by turns, since one may be hard to get away from. NavigationError NO_VALID_PATH is raised if the whole space was
    searched and there is no way for the outline; if the search is given up before, the plan is still that of the
    circle, as from a start where the robot overlaps an obstacle.

    If the circle's path is not a plan, the rest of a path ``before`` to the same goal is, as long as the outline has
    room on it and the robot is on it.
    """

    def _way(
        self,
        start: Pose,
        source: Cell,
        goal: Pose,
        target: Cell,
        stop: StopFlag,
        before: Sequence[Sequence[Pose]],
    ) -> list[Pose]:
        path = super()._way(start, source, goal, target, stop, before)
        if self._costmap.in_collision(start) or self._is_drivable(path, start.yaw):
            return path
        if rest := self._rest(before, start, goal):
            return rest
        way = self._outline_way(start, source, goal, target, stop)
        return path if way is None else self._along(start, self._straightened(way, stop), goal)

    def _is_drivable(self, path: Sequence[Pose], yaw: float) -> bool:
        """Return whether the outline has room along a path; ``yaw`` is the heading at its beginning."""
        world = self._costmap.world
        x, y, yaws = numpy.array(path).T
        way = (x - world.origin.x + 1j * (y - world.origin.y)) * numpy.exp(-1j * world.origin.yaw) / world.resolution
        points = numpy.stack([way.real, way.imag], axis=1)
        ends = yaw - world.origin.yaw, float(yaws[-1]) - world.origin.yaw
        return bool(room_on_way(self.shape, points, *ends) >= 0.0)

    def _rest(self, paths: Sequence[Sequence[Pose]], start: Pose, goal: Pose) -> list[Pose]:
        """Return what is left of the first path that leads to the goal, has room, and has the robot on it; [] without
        one."""
        for path in paths:
            if path and path[-1] == goal:
                beside = [self._beside(start, pose) for pose in path]
                rest = path[beside.index(min(beside)) :]
                if min(beside) <= self._on_path and self._is_free(rest, start.yaw):
                    return list(rest)
        return []

    @property
    def _on_path(self) -> float:
        """Maximum distance from a path at which the robot is still on it, m."""
        return ON_PATH

    def _beside(self, start: Pose, pose: Pose) -> float:
        """Return how far, m, a robot is from a pose of a path."""
        return start.distance(pose)

    def _is_free(self, path: Sequence[Pose], yaw: float) -> bool:
        """Return whether the rest of a path before has room."""
        return self._is_drivable(path, yaw)

    def _outline_way(
        self, start: Pose, source: Cell, goal: Pose, target: Cell, stop: StopFlag
    ) -> NDArray[numpy.float64] | None:
        """Points of a way that the outline has room on, shape (n, 2), in cells; None when the search is given up."""
        begin, end = self.on_grid(start), self.on_grid(goal)
        margin = max(1.0, OUTLINE_MARGIN / self._costmap.world.resolution)

        @cache
        def problem(turned: bool) -> tuple[Any, ...]:
            there = self._costs_to(source if turned else target, stop)
            ends = (turned_round(end), turned_round(begin)) if turned else (begin, end)
            shape = self.shape_turned if turned else self.shape
            return shape, margin, self._costmap.costs, WEIGHTS, self._is_roomy, there, *ends

        looked, share = 0, min(1.0, USUAL_REACH * self._costmap.world.resolution / self._costmap.inflation.outer_radius)
        for limit, turned in product(MOST_OUTLINES if outline_search.compiled else MOST_INTERPRETED, (False, True)):
            most = math.ceil(share * limit)
            way, states = outline_search(*problem(turned), most, stop.cell)
            stop.check()
            if len(way):
                points: NDArray[numpy.float64] = way[::-1] if turned else way
                return points
            looked += states
            if states < most:
                raise NavigationError(
                    'NO_VALID_PATH',
                    f'no way with room for the outline of the robot leads to the goal ({goal.x:.2f}, {goal.y:.2f}), '
                    f'of {looked} places and headings that were looked at',
                )
        return None

    def _costs_to(self, cell: Cell, stop: StopFlag) -> NDArray[numpy.float32]:
        """Return what the way to a cell costs from each other one, infinite without a way."""
        costs = numpy.pad(self._costmap.costs, 1, constant_values=LETHAL)
        number = (cell[0] + 1) * costs.shape[1] + cell[1] + 1
        _, spent = search(costs, WEIGHTS, number, 0, stop.cell)
        stop.check()
        return numpy.ascontiguousarray(spent.reshape(costs.shape)[1:-1, 1:-1])

    @cached_property
    def _is_roomy(self) -> NDArray[numpy.bool_]:
        """The cells in which the robot can turn anywhere."""
        costmap = self._costmap
        needed = 2.0 * (costmap.inflation.outer_radius / costmap.world.resolution + ROUND_OUTLINE)
        return (costmap.squares >= needed**2) & (costmap.costs < INSCRIBED)

    def _straightened(self, way: NDArray[numpy.float64], stop: StopFlag) -> list[Position]:
        """Corners of a way: straight lines between places where the robot can turn, where its outline has room."""
        way = way[numpy.append(True, numpy.hypot(*numpy.diff(way, axis=0).T) > SAME_PLACE)]
        cells = numpy.floor(way).astype(int)
        is_roomy = self._is_roomy[cells[:, 1], cells[:, 0]].tolist()

        def fits(i: int, j: int) -> bool:
            (x, y), (right, up) = way[i].tolist(), (way[j] - way[i]).tolist()
            pose = x, y, math.atan2(up, right)
            return is_roomy[i] and is_roomy[j] and room_along(self.shape, pose, right, up, 0.0) >= 0.0

        return self._pull_straight([(y, x) for x, y in way.tolist()], stop, fits)

    @cached_property
    def shape(self) -> Outline:
        """Obstacles and robot, in cells."""
        costmap, cell = self._costmap, self._costmap.world.resolution
        corners = numpy.array(costmap.inflation.corners, numpy.float64).reshape(-1, 2) / cell
        reach = costmap.inflation.outer_radius / cell
        return Outline(costmap.obstacles, costmap.squares, corners, _discs(corners, reach), reach)

    @property
    def shape_turned(self) -> Outline:
        """Shape with the robot the other way round: on the way back it drives as this one does on the way there."""
        shape = self.shape
        return shape._replace(corners=-shape.corners, discs=shape.discs * (-1.0, -1.0, 1.0))

    def on_grid(self, pose: Pose) -> GridPose:
        """Return a pose in cells, as the loops have it."""
        world = self._costmap.world
        row, column = world.grid_position(pose.x, pose.y)
        return column, row, float(pose.yaw - world.origin.yaw)


def turned_round(pose: GridPose) -> GridPose:
    """Return a pose with the opposite heading."""
    x, y, yaw = pose
    return x, y, yaw + math.pi


def _discs(corners: NDArray[numpy.float64], reach: float) -> NDArray[numpy.float64]:
    """Centres and radii, shape (n, 3), of circles that have all of a robot within them: along its longer side, those
    round rectangles that are half as long as wide.
    """
    if not len(corners):
        return numpy.array([[0.0, 0.0, reach]])
    low, high = corners.min(axis=0), corners.max(axis=0)
    along = int((high - low).argmax())
    count = min(MOST_DISCS, math.ceil(2.0 * (high - low).max() / (high - low).min()))
    side = (high - low) / numpy.where(numpy.arange(2) == along, count, 1)
    discs = numpy.empty((count, 3))
    discs[:, :2], discs[:, 2] = (low + high) / 2.0, math.hypot(*side) / 2.0
    discs[:, along] = low[along] + side[along] * (numpy.arange(count) + 0.5)
    return discs
