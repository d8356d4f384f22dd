# SPDX-License-Identifier: BSD-3-Clause
"""Path planning on a costmap, for each kind of robot.

For a circular footprint, the planner finds a cheapest path over the grid and straightens it to any angle where that
costs no more. For another footprint that turns on the spot, it searches over positions and headings where the outline
has no room on that path, as Nav2's SmacPlannerLattice with the primitives of this robot. For car-like steering, it uses
Hybrid A*, as Nav2's SmacPlannerHybrid.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from functools import cache, cached_property
from itertools import pairwise, product
from typing import Any, Final, NamedTuple

import numpy
from numpy.typing import NDArray

from flexbt_navigation.controller.motions import Steering
from flexbt_navigation.costmaps.costmap import INSCRIBED, LETHAL, Costmap, Position
from flexbt_navigation.costmaps.kernels import Costs, neighbours, search
from flexbt_navigation.errors import NavigationError
from flexbt_sim.world.plane.geometry import Pose, wrap

from .hybrid_kernels import (
    NEAR,
    PIECE,
    SLACK,
    GridPose,
    Outline,
    Ways,
    hybrid_search,
    moved,
    outline_search,
    room,
    room_along,
    room_on_way,
    ways_to,
)

NEUTRAL_COST: Final = 50.0
COST_FACTOR: Final = 0.8
"""Crossing a cell costs 50 + 0.8 * cost, as in Nav2's NavFn."""

SPACING: Final = 0.05
"""Distance between the poses of a path, m."""

END_TOLERANCE: Final = 0.3
"""Maximum distance of start and goal from a free cell, m: a robot that touches a wall has to get away from it."""

SPARE: Final = 0.01
"""Additional distance of a straight line from obstacles, m, so that small deviations of the follower do not matter. It
is at most half of the spare distance of the cells that the line replaces."""

WEIGHTS: Final = numpy.where(numpy.arange(256) < INSCRIBED, NEUTRAL_COST + COST_FACTOR * numpy.arange(256), math.inf)
"""Cost of crossing a cell, by its cost; infinite where the robot cannot be."""

Cell = tuple[int, int]


class PlanningStopped(NavigationError):
    """The plan is no longer needed."""


class StopFlag:
    """A flag that stops planning on another thread."""

    def __init__(self) -> None:
        self.cell: Costs = numpy.zeros(1, numpy.uint8)

    def set(self) -> None:
        """Stop planning. From any thread."""
        self.cell[0] = 1

    def check(self) -> None:
        """Raise PlanningStopped if the flag is set."""
        if self.cell[0]:
            raise PlanningStopped('UNKNOWN', 'the plan is not wanted any more')


class PathEnds(NamedTuple):
    """The ends of a path, and the free cells near them that it connects."""

    start: Pose
    source: Cell
    goal: Pose
    target: Cell


class GridPlanner:
    """A planner on one costmap."""

    def __init__(self, costmap: Costmap, tolerance: float = 0.0) -> None:
        """``tolerance`` in m: if the goal is occupied or cannot be reached, the path ends at the nearest reachable cell
        within a square of this half width around it, with the heading of the goal."""
        self._costmap = costmap
        self._tolerance = tolerance

    def plan_through(
        self,
        start: Pose,
        goals: Sequence[Pose],
        stop: StopFlag | None = None,
        before: Sequence[Sequence[Pose]] = (),
    ) -> list[list[Pose]]:
        """Return the legs of a path through all goals; each begins where the previous one ends. Raises as :meth:`plan`.

        ``before`` is used for the first leg only: the others begin at a goal, not where the robot is.
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
        """Return a path from start to goal that ends with the pose of the goal. It is this pose alone if both are at
        the same position.

        The robot overlaps no obstacle at its poses or between them. If it overlaps one at the start, the path leads
        straight out. ``before`` are paths that the robot may be on, for planners that continue them.

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
        return self._way(PathEnds(start, source, goal, target), stop, before)

    def _way(self, ends: PathEnds, stop: StopFlag, before: Sequence[Sequence[Pose]]) -> list[Pose]:
        """Return a path for ends whose cells are connected over free cells."""
        cells = self._search(ends.source, ends.target, stop).tolist()
        begin, end = (self._costmap.world.grid_position(*pose[:2]) for pose in (ends.start, ends.goal))
        way = [begin, *((row + 0.5, column + 0.5) for row, column in cells), end]
        return self._along(ends.start, self._pull_straight(way, stop), ends.goal)

    def _along(self, start: Pose, corners: Sequence[Position], goal: Pose) -> list[Pose]:
        """Return a path with corners at these positions; the first and the last are start and goal."""
        points = [self._costmap.world.point(row - 0.5, column - 0.5) for row, column in corners]
        return _resample([(start.x, start.y), *points[1:-1], (goal.x, goal.y)], goal)

    def _occupied(self, goal: Pose) -> NavigationError:
        """Return the error for an occupied goal. An obstacle of the map is permanent. An obstacle that was seen may go
        away, and trees wait for that and retry."""
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
        """Return the nearest free cell that the robot can reach on a straight line without getting closer to an
        obstacle.

        Return None if the centre of the robot is in an obstacle.
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
        """Return the nearest reachable cell within the tolerance where the robot fits with this heading."""
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
        """Return the free cells of a square around a position, ``distance`` in m to each side, nearest first."""
        reach = math.ceil(distance / self._costmap.world.resolution)
        bottom, left = (max(0, math.floor(value) - reach) for value in position)
        top, right = (math.floor(value) + reach + 1 for value in position)
        cells = numpy.add(numpy.argwhere(self._costmap.costs[bottom:top, left:right] < INSCRIBED), (bottom, left))
        nearest_first = numpy.argsort(((cells + 0.5 - position) ** 2).sum(axis=1), kind='stable')
        return [(row, column) for row, column in cells[nearest_first].tolist()]

    def _search(self, source: Cell, target: Cell, stop: StopFlag) -> NDArray[numpy.int64]:
        """Return the cells of a cheapest path, shape (n, 2)."""
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
        """Return the corners of a path over cells, straightened where the line is free, costs no more than the part it
        replaces, and where ``fits`` accepts the line from one point of the path to another."""
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
        """Return the radii, m, that a straight line past these positions must keep free: the robot's plus the spare."""
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
    """Return poses along straight lines between corners, each heading to the next; the last is the goal."""
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


MOST_DISCS: Final = 20
"""Maximum number of discs that approximate a robot in the check before the one of its outline."""

MOST_OUTLINES: Final = (20_000, 150_000, 1_000_000)
"""Maximum number of positions and headings examined from either end, alternately, before the search gives up: about
five seconds."""

USUAL_REACH: Final = 10.0
"""Reach of a robot, in cells, for which these numbers hold. They are lower for a larger robot, since each position
takes longer."""

MOST_OUTLINES_INTERPRETED: Final = (1_000, 4_000)
"""The same without compiled code."""

ROUND_OUTLINE: Final = 1.0
"""Room beyond the robot's reach, in cells, required at the centre of a cell for turning anywhere in it."""

OUTLINE_MARGIN: Final = 0.05
"""Distance to obstacles, m, within which the path costs more."""

SAME_PLACE: Final = 1e-6
"""Distance, in cells, below which two points count as the same."""

ON_PATH: Final = 0.1
"""Maximum distance from a path at which the robot is still on it, m."""


class OutlinePlanner(GridPlanner):
    """A planner on one costmap for a robot whose footprint is a polygon.

    The plan is that of the largest circle that fits into the footprint, if the outline has room all along it, where the
    robot turns, and for the headings of start and goal. Otherwise it is searched for by position and heading, from both
    ends alternately, since one of them may be hard to leave. If the whole space was searched without a path for the
    outline, planning raises NavigationError NO_VALID_PATH. If the search gives up before, or the robot overlaps an
    obstacle at the start, the plan remains that of the circle.

    If the circle's path cannot be used, the rest of a path ``before`` to the same goal is the plan, as long as the
    outline has room on it and the robot is on it.
    """

    def _way(self, ends: PathEnds, stop: StopFlag, before: Sequence[Sequence[Pose]]) -> list[Pose]:
        path, start = super()._way(ends, stop, before), ends.start
        if self._costmap.in_collision(start) or self._is_drivable(path, start.yaw):
            return path
        if rest := self._rest(before, start, ends.goal):
            return rest
        way = self._outline_way(ends, stop)
        return path if way is None else self._along(start, self._straightened(way, stop), ends.goal)

    def _is_drivable(self, path: Sequence[Pose], yaw: float) -> bool:
        """Return whether the outline has room along a path; ``yaw`` is the heading at its beginning."""
        world = self._costmap.world
        x, y, yaws = numpy.array(path).T
        way = (x - world.origin.x + 1j * (y - world.origin.y)) * numpy.exp(-1j * world.origin.yaw) / world.resolution
        points = numpy.stack([way.real, way.imag], axis=1)
        ends = yaw - world.origin.yaw, float(yaws[-1]) - world.origin.yaw
        return bool(room_on_way(self.shape, points, *ends) >= 0.0)

    def _rest(self, paths: Sequence[Sequence[Pose]], start: Pose, goal: Pose) -> list[Pose]:
        """Return the rest of the first path leading to the goal, with room and the robot on it; [] without one."""
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
        """Return whether the rest of a previous path has room."""
        return self._is_drivable(path, yaw)

    def _outline_way(self, ends: PathEnds, stop: StopFlag) -> NDArray[numpy.float64] | None:
        """Return the points, shape (n, 2), in cells, of a path with room for the outline; None when the search gives
        up."""
        start, source, goal, target = ends
        begin, end = self.on_grid(start), self.on_grid(goal)
        margin = max(1.0, OUTLINE_MARGIN / self._costmap.world.resolution)

        @cache
        def problem(turned: bool) -> tuple[Any, ...]:
            there = self._costs_to(source if turned else target, stop)
            poses = (turned_round(end), turned_round(begin)) if turned else (begin, end)
            shape = self.shape_turned if turned else self.shape
            return shape, margin, self._costmap.costs, WEIGHTS, self._is_roomy, there, *poses

        looked, share = 0, min(1.0, USUAL_REACH * self._costmap.world.resolution / self._costmap.inflation.outer_radius)
        for limit, turned in product(
            MOST_OUTLINES if outline_search.compiled else MOST_OUTLINES_INTERPRETED, (False, True)
        ):
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
        """Return the cost of the path to a cell from every other cell, infinite without a path."""
        costs = numpy.pad(self._costmap.costs, 1, constant_values=LETHAL)
        number = (cell[0] + 1) * costs.shape[1] + cell[1] + 1
        _, spent = search(costs, WEIGHTS, number, 0, stop.cell)
        stop.check()
        return numpy.ascontiguousarray(spent.reshape(costs.shape)[1:-1, 1:-1])

    @cached_property
    def _is_roomy(self) -> NDArray[numpy.bool_]:
        """Mask of the cells in which the robot can turn anywhere."""
        costmap = self._costmap
        needed = 2.0 * (costmap.inflation.outer_radius / costmap.world.resolution + ROUND_OUTLINE)
        return (costmap.squares >= needed**2) & (costmap.costs < INSCRIBED)

    def _straightened(self, way: NDArray[numpy.float64], stop: StopFlag) -> list[Position]:
        """Return the corners of a path that uses straight lines between turning points, where its outline has room."""
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
        """The shape of the robot turned around: it drives backward along a path as this one drives forward."""
        shape = self.shape
        return shape._replace(corners=-shape.corners, discs=shape.discs * (-1.0, -1.0, 1.0))

    def on_grid(self, pose: Pose) -> GridPose:
        """Return a pose in cells, as the kernels use it."""
        world = self._costmap.world
        row, column = world.grid_position(pose.x, pose.y)
        return column, row, float(pose.yaw - world.origin.yaw)


def turned_round(pose: GridPose) -> GridPose:
    """Return a pose with the opposite heading."""
    x, y, yaw = pose
    return x, y, yaw + math.pi


def _discs(corners: NDArray[numpy.float64], reach: float) -> NDArray[numpy.float64]:
    """Return centres and radii, shape (n, 3), of circles that cover a robot: along its longer side, around rectangles
    that are half as long as wide."""
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


STEERING_RESERVE: Final = 1.1
"""Factor by which bends are planned wider than the robot can drive, so that it can also correct back to the path."""

MARGIN: Final = 0.05
"""Distance to obstacles, in turning radii, within which the path costs more: the robot may deviate this far from it."""

TIGHT: Final = -0.02
"""Slack, in cells, where the robot has no room to spare."""

MOST_STATES: Final = (1_000, 4_000, 16_000, 64_000)
"""Maximum number of states examined from either end, alternately, before the search gives up: about one second."""

MOST_STATES_INTERPRETED: Final = MOST_STATES[:2]
"""The same without compiled code: about six seconds."""

SHORTEST: Final = 1.5
"""Minimum length of the pieces of a path, in cells."""

MOST_BLOCKS: Final = 60_000
"""Over which the ways to the goal are known beforehand."""


def planner_for(costmap: Costmap, steering: Steering, tolerance: float = 0.0) -> GridPlanner:
    """Return the planner for a robot; ``tolerance`` as for :class:`GridPlanner`."""
    if steering.turning_radius:
        return HybridPlanner(costmap, steering, tolerance)
    if costmap.inflation.corners:
        return OutlinePlanner(costmap, tolerance)
    return GridPlanner(costmap, tolerance)


class HybridPlanner(OutlinePlanner):
    """A planner on one costmap for a car-like robot. Its poses have the heading of the robot, which drives backward to
    a pose behind it.

    :meth:`plan` returns a path that the robot can drive, with the poses of start and goal at its ends. It searches from
    both ends alternately: one end may be hard to leave, and from there few states are left to examine. A robot that is
    turned around drives from the goal to the start where this one drives from the start to the goal. If that finds no
    path, the planner searches with shorter pieces before it reports that there is none. If the search takes long,
    either end may be hard to reach; then the planner tries paths from both to a place with room between them.

    The rest of a path ``before``, of this planner and to the same goal, is the plan as long as it is free and the robot
    is nearly on it. It begins at its pose nearest to the start. This prevents a robot from alternating between two
    paths of nearly the same cost, one that begins forward and one that begins backward, without progress. Planning also
    raises NavigationError TIMEOUT when the search gives up.
    """

    def __init__(self, costmap: Costmap, steering: Steering, tolerance: float = 0.0) -> None:
        """``tolerance`` as for :class:`GridPlanner`; the turning radius of ``steering`` is above 0."""
        super().__init__(costmap, tolerance)
        self._steering = steering

    def _way(self, ends: PathEnds, stop: StopFlag, before: Sequence[Sequence[Pose]]) -> list[Pose]:
        start, source, goal, target = ends
        costmap = self._costmap
        cell = costmap.world.resolution
        if costmap.in_collision(start):
            raise NavigationError(
                'START_OCCUPIED' if costmap.touches_map(start) else 'NO_VALID_PATH',
                f'at the start ({start.x:.2f}, {start.y:.2f}) the robot overlaps an obstacle',
            )
        if rest := self._rest(before, start, goal):
            return rest
        radius = self._steering.turning_radius * STEERING_RESERVE / cell
        begin, end = self.on_grid(start), self.on_grid(goal)
        # If an end has less room, the whole path may be as close to obstacles.
        slack = SLACK if all(room(self.shape, SLACK, *one) >= 0.0 for one in (begin, end)) else TIGHT
        rules = slack, max(1.0, MARGIN * radius)

        @cache
        def problem(turned: bool) -> tuple[Any, ...]:
            if not turned:
                return self.shape, *rules, self._ahead(target, radius), begin, end
            return self.shape_turned, *rules, self._ahead(source, radius), turned_round(end), turned_round(begin)

        def halves() -> Iterator[tuple[Any, ...]]:
            """Yield the problems of reaching a place in the middle, from the start and from the goal."""
            *_, ways, _, _ = problem(False)
            if gate := self._gate(ways, source, radius):
                ahead = self._ahead((int(gate[1]), int(gate[0])), radius)
                yield self.shape, *rules, ahead, begin, gate
                yield self.shape_turned, *rules, ahead, turned_round(end), turned_round(gate)

        lengths = sorted({max(SHORTEST, PIECE * radius / share) for share in (1.0, 2.0)})
        untried, looked = {turned: lengths.copy() for turned in (False, True)}, 0
        for number, most in enumerate(MOST_STATES if hybrid_search.compiled else MOST_STATES_INTERPRETED):
            parts: list[NDArray[numpy.float64]] = []
            for half in halves() if number == 1 else ():
                pieces, states = self._searched(half, radius, lengths.copy(), most, stop)
                looked += states
                if not len(pieces):
                    break
                parts.append(_driven_back(pieces) if parts else pieces)
            if len(parts) == 2:
                return _sampled(start, numpy.concatenate(parts) * (1.0, cell), radius * cell, goal)
            for turned, left in untried.items():
                pieces, states = self._searched(problem(turned), radius, left, most, stop)
                looked += states
                if len(pieces):
                    pieces = _driven_back(pieces) if turned else pieces
                    return _sampled(start, pieces * (1.0, cell), radius * cell, goal)
                if not left:
                    raise self._no_way('NO_VALID_PATH', goal, looked)
        raise self._no_way('TIMEOUT', goal, looked)

    def _searched(
        self, problem: tuple[Any, ...], radius: float, lengths: list[float], most: int, stop: StopFlag
    ) -> tuple[NDArray[numpy.float64], int]:
        """Return the pieces of a path, empty when none was found, and the number of states examined: at most ``most``
        for each length of pieces. Lengths without a path are removed; the last one is tried first."""
        looked, pieces = 0, numpy.empty((0, 2))
        while lengths:
            pieces, states = hybrid_search(*problem, radius, lengths[-1], self._steering.reverses, most, stop.cell)
            stop.check()
            looked += states
            if len(pieces) or states == most:
                break
            lengths.pop()
        return pieces, looked

    def _gate(self, ways: Ways, source: Cell, radius: float) -> GridPose | None:
        """Return the pose with the most room on a path over blocks, without its ends, with the heading of the path
        there."""
        height, width = self._costmap.costs.shape
        block, following = ways.block, ways.following
        across = (width + block - 1) // block
        way = [source[0] // block * across + source[1] // block]
        while following[way[-1]] != way[-1]:
            way.append(int(following[way[-1]]))
        near = math.ceil(radius / block / 2.0)
        rows, columns = ((numpy.divmod(way, across)[axis] + 0.5) * block for axis in (0, 1))
        cells = numpy.minimum(rows, height - 1).astype(int), numpy.minimum(columns, width - 1).astype(int)
        between = self._costmap.squares[cells][near:-near]
        if not between.size:
            return None
        middle = near + int(between.argmax())
        before, after = middle - near, middle + near
        course = math.atan2(rows[after] - rows[before], columns[after] - columns[before])
        gate = float(cells[1][middle]) + 0.5, float(cells[0][middle]) + 0.5, course
        return gate if room(self.shape, SLACK, *gate) >= 0.0 else None

    def _no_way(self, code: str, goal: Pose, looked: int) -> NavigationError:
        return NavigationError(
            code,
            f'no way with bends of {self._steering.turning_radius:g} m leads to the goal ({goal.x:.2f}, '
            f'{goal.y:.2f}){"" if self._steering.reverses else " without driving backward"}, '
            f'of {looked} places and headings that were looked at',
        )

    @property
    def _on_path(self) -> float:
        return 2.0 * MARGIN * self._steering.turning_radius

    def _beside(self, start: Pose, pose: Pose) -> float:
        return start.distance(pose) + self._steering.turning_radius * abs(wrap(pose.yaw - start.yaw))

    def _is_free(self, path: Sequence[Pose], yaw: float) -> bool:
        """Return whether the rest of a previous path has room; its poses have the heading of the robot."""
        return all(room(self.shape, TIGHT, *self.on_grid(pose)) >= 0.0 for pose in path)

    def _ahead(self, target: Cell, radius: float) -> Ways:
        """Return the paths to a cell."""
        free = self._costmap.costs < INSCRIBED
        block = math.ceil(math.sqrt(free.size / MOST_BLOCKS))
        free = numpy.pad(free, [(0, -size % block) for size in free.shape])
        blocks = numpy.asarray(free.reshape(free.shape[0] // block, block, -1, block).any(axis=(1, 3)))
        ways: Ways = ways_to(blocks, target[0] // block, target[1] // block, NEAR * radius / block, block)
        return ways


def _driven_back(pieces: NDArray[numpy.float64]) -> NDArray[numpy.float64]:
    """Return the pieces of a path, reversed from end to beginning, for a robot that is turned around."""
    return pieces[::-1] * (-1.0, 1.0)


def _sampled(start: Pose, pieces: NDArray[numpy.float64], radius: float, goal: Pose) -> list[Pose]:
    """Return poses along pieces, turn and length in m; the last is the goal."""
    path = [start]
    for turn, length in pieces.tolist():
        begin, count = path[-1], math.ceil(abs(length) / SPACING - 1e-6)
        path += [Pose(*moved(*begin, turn, length * i / count, radius)) for i in range(1, count + 1)]
    return [*path[:-1], goal]
