# SPDX-License-Identifier: BSD-3-Clause
"""Plans against a slow search that checks every obstacle, and Nav2's error codes."""

from __future__ import annotations

import heapq
import math
from collections.abc import Sequence
from itertools import pairwise, product

import numpy
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from flexbt_navigation.costmaps.costmap import Costmap, Inflation
from flexbt_navigation.errors import NavigationError
from flexbt_navigation.planner.planners import END_TOLERANCE, SPACING, GridPlanner
from flexbt_sim.world import OccupancyMap, Pose, wrap
from flexbt_testing.worlds import drawn, places, room, rooms, worlds

INFLATION = Inflation()
RADIUS = INFLATION.robot_radius
Cell = tuple[int, int]
thorough = settings(deadline=None, max_examples=10)


class SlowSearch:
    """Dijkstra's search over the centres of the cells. Steps are checked all along."""

    def __init__(self, world: OccupancyMap, costs: NDArray[numpy.uint8]) -> None:
        self._world = world
        self._weights = 50.0 + 0.8 * costs.astype(float)
        cells = list(product(range(world.height), range(world.width)))
        distances = rooms(world, numpy.array([world.point(*cell) for cell in cells]))
        self.free = {cell for cell, distance in zip(cells, distances, strict=True) if distance > RADIUS}
        steps = [
            (cell, (cell[0] + up, cell[1] + right))
            for cell in self.free
            for up, right in ((0, 1), (1, 0), (1, 1), (1, -1))
            if (cell[0] + up, cell[1] + right) in self.free
        ]
        self.ways: dict[Cell, list[tuple[Cell, float]]] = {cell: [] for cell in self.free}
        parts = numpy.linspace(0.0, 1.0, 25)[:, None]
        for a, b in steps:
            start, end = numpy.array(world.point(*a)), numpy.array(world.point(*b))
            if rooms(world, (1.0 - parts) * start + parts * end).min() >= RADIUS - 1e-9:
                cost = math.dist(a, b) * (self._weights[a] + self._weights[b]) / 2.0
                self.ways[a].append((b, cost))
                self.ways[b].append((a, cost))

    def cheapest(self, start: Cell, goal: Cell) -> float:
        """Cost of the best way; infinite when there is none."""
        best, queue = {start: 0.0}, [(0.0, start)]
        while queue:
            cost, cell = heapq.heappop(queue)
            if cell == goal:
                return cost
            for ahead, step in self.ways[cell] if cost == best[cell] else ():
                if cost + step < best.get(ahead, math.inf):
                    best[ahead] = cost + step
                    heapq.heappush(queue, (cost + step, ahead))
        return math.inf


def fine(path: Sequence[Pose]) -> NDArray[numpy.float64]:
    """Points all along a path."""
    parts = numpy.linspace(0.0, 1.0, 10)[:, None]
    return numpy.concatenate(
        [numpy.array([path[-1][:2]]), *((1.0 - parts) * a[:2] + parts * b[:2] for a, b in pairwise(path))]
    )


def spent(costmap: Costmap, path: Sequence[Pose]) -> float:
    """Return what driving along a path costs, by the law of Nav2's NavFn."""
    total = 0.0
    for a, b in pairwise(path):
        for part in numpy.linspace(0.05, 0.95, 10):
            cell = costmap.world.cell(a.x + part * (b.x - a.x), a.y + part * (b.y - a.y))
            total += a.distance(b) / 10.0 / costmap.world.resolution * (50.0 + 0.8 * float(costmap.costs[cell]))
    return total


def check_form(path: Sequence[Pose], start: Pose, goal: Pose) -> None:
    """From start to goal, in small steps, each pose heading to the next, no pose twice."""
    assert path[-1] == goal
    assert math.dist(path[0][:2], start[:2]) < 1e-9
    for here, ahead in pairwise(path):
        assert 0.0 < here.distance(ahead) <= SPACING + 1e-9
        assert abs(wrap(math.atan2(ahead.y - here.y, ahead.x - here.x) - here.yaw)) < 1e-6


small = worlds(least=12, size=22, blocks=7, resolutions=(0.07, 0.15, 0.4))


@thorough
@given(st.data(), small)
def test_there_is_a_plan_where_there_is_a_way_and_it_is_as_cheap(data: st.DataObject, world: OccupancyMap) -> None:
    costmap = Costmap(world, INFLATION)
    search = SlowSearch(world, costmap.costs)
    cells = sorted(search.free)
    assume(cells)
    planner = GridPlanner(costmap)
    for _ in range(4):
        start_cell, goal_cell = data.draw(st.sampled_from(cells)), data.draw(st.sampled_from(cells))
        start, goal = (Pose(*world.point(*cell), data.draw(st.floats(-3, 3))) for cell in (start_cell, goal_cell))
        best = search.cheapest(start_cell, goal_cell)
        try:
            path = planner.plan(start, goal)
        except NavigationError as error:
            assert error.code == 'NO_VALID_PATH'
            assert best == math.inf
        else:
            check_form(path, start, goal)
            assert rooms(world, fine(path)).min() >= RADIUS - 1e-6
            assert spent(costmap, path) <= 1.05 * best


@thorough
@given(st.data(), small)
def test_whatever_is_asked_the_plan_is_free_or_the_error_is_right(data: st.DataObject, world: OccupancyMap) -> None:
    planner = GridPlanner(Costmap(world, INFLATION))
    for _ in range(6):
        start, goal = data.draw(places(world, beside=0.5)), data.draw(places(world, beside=0.5))
        outside = {
            name for name, pose in (('START', start), ('GOAL', goal)) if not world.contains(*world.cell(pose.x, pose.y))
        }
        at_start, at_goal = room(world, *start[:2]), room(world, *goal[:2])
        try:
            path = planner.plan(start, goal)
        except NavigationError as error:
            which, _, what = error.code.partition('_')
            if what == 'OUTSIDE_MAP':
                assert which in outside
            elif what == 'OCCUPIED':
                assert not outside
                assert (at_start if which == 'START' else at_goal) < RADIUS + world.resolution
            else:
                assert error.code == 'NO_VALID_PATH'
        else:
            assert not outside
            assert at_goal >= RADIUS
            check_form(path, start, goal)
            distances = rooms(world, fine(path))
            # Start and goal are up to 0.71 cells from the centre of a cell, on a line that is sampled.
            tolerance = world.resolution**2 / (32.0 * min(RADIUS, at_start)) + 1e-5 if at_start else 0.0
            assert distances.min() >= min(RADIUS, at_start) - tolerance
            away = numpy.hypot(*(fine(path) - start[:2]).T) > END_TOLERANCE + 1.5 * world.resolution
            assert distances[away].min(initial=math.inf) >= RADIUS - tolerance


@thorough
@given(st.data(), small)
def test_a_place_with_room_round_it_is_never_refused(data: st.DataObject, world: OccupancyMap) -> None:
    """And between such places there is a plan if and only if the cells are connected."""
    costmap = Costmap(world, INFLATION)
    search = SlowSearch(world, costmap.costs)
    start, goal = data.draw(places(world, beside=-0.01)), data.draw(places(world, beside=-0.01))
    assume(min(room(world, *start[:2]), room(world, *goal[:2])) > RADIUS + 0.75 * world.resolution)
    connected = search.cheapest(world.cell(*start[:2]), world.cell(*goal[:2])) < math.inf
    try:
        path = GridPlanner(costmap).plan(start, goal)
    except NavigationError as error:
        assert error.code == 'NO_VALID_PATH'
        assert not connected
    else:
        assert connected
        assert rooms(world, fine(path)).min() >= RADIUS - 1e-6


def test_in_the_open_the_plan_is_the_straight_line() -> None:
    world = drawn(*['.' * 100] * 60, origin=Pose(1.0, 2.0, 0.5))
    start, goal = Pose(1.5, 3.5, 0.0), Pose(4.2, 5.1, 1.0)
    path = GridPlanner(Costmap(world, INFLATION)).plan(start, goal)
    assert sum(a.distance(b) for a, b in pairwise(path)) == pytest.approx(start.distance(goal), rel=1e-3)


def test_start_and_goal_in_one_place_give_one_pose() -> None:
    planner = GridPlanner(Costmap(drawn(*['.' * 40] * 40), INFLATION))
    assert planner.plan(Pose(0.61, 0.72, 0.0), Pose(0.61, 0.72, 2.0)) == [(0.61, 0.72, 2.0)]


@pytest.mark.parametrize('size', [(1, 1), (1, 30), (30, 1)])
def test_the_smallest_maps(size: tuple[int, int]) -> None:
    world = drawn(*['.' * size[1]] * size[0])
    start, goal = Pose(0.01, 0.02, 0.0), Pose(size[1] * 0.05 - 0.01, size[0] * 0.05 - 0.01, 1.0)
    check_form(GridPlanner(Costmap(world, INFLATION)).plan(start, goal), start, goal)


ROOMS = drawn('#' * 30, *['#............##..........??..#'] * 12, '#' * 30, resolution=0.1)
LEFT, RIGHT = Pose(0.65, 0.7, 0.0), Pose(2.0, 0.7, 0.0)


@pytest.mark.parametrize(
    ('start', 'goal', 'code'),
    [
        (Pose(-0.1, 0.5, 0.0), LEFT, 'START_OUTSIDE_MAP'),
        (Pose(math.nan, 0.5, 0.0), LEFT, 'START_OUTSIDE_MAP'),
        (Pose(1e300, -math.inf, 0.0), LEFT, 'START_OUTSIDE_MAP'),
        (LEFT, Pose(0.6, 1.41, 0.0), 'GOAL_OUTSIDE_MAP'),
        (LEFT, Pose(0.6, math.inf, 0.0), 'GOAL_OUTSIDE_MAP'),
        (LEFT, Pose(3.0, 0.7, 0.0), 'GOAL_OUTSIDE_MAP'),
        (LEFT, Pose(1.4, 0.7, 0.0), 'GOAL_OCCUPIED'),
        (LEFT, Pose(0.31, 0.7, 0.0), 'GOAL_OCCUPIED'),
        (Pose(1.4, 0.7, 0.0), LEFT, 'START_OCCUPIED'),
        (LEFT, RIGHT, 'NO_VALID_PATH'),
    ],
)
def test_error_codes_of_nav2(start: Pose, goal: Pose, code: str) -> None:
    with pytest.raises(NavigationError) as raised:
        GridPlanner(Costmap(ROOMS, INFLATION)).plan(start, goal)
    assert raised.value.code == code


def test_unknown_space_is_planned_through_and_to() -> None:
    path = GridPlanner(Costmap(ROOMS, INFLATION)).plan(RIGHT, Pose(2.55, 0.7, 0.0))
    assert ROOMS.cells[ROOMS.cell(*path[-1][:2])] == -1


@pytest.mark.parametrize('x', [1.2, 1.29, 1.61, 1.7])
def test_a_robot_that_overlaps_a_wall_leaves_it_on_its_own_side(x: float) -> None:
    """The free cells on the other side of the wall may be as near."""
    here, there = (LEFT, RIGHT) if x < 1.4 else (RIGHT, LEFT)
    planner = GridPlanner(Costmap(ROOMS, INFLATION))
    path = planner.plan(Pose(x, 0.7, 0.0), here)
    assert all((pose.x < 1.3) == (x < 1.4) for pose in path)
    with pytest.raises(NavigationError) as raised:
        planner.plan(Pose(x, 0.7, 0.0), there)
    assert raised.value.code == 'NO_VALID_PATH'


def test_a_robot_in_the_middle_of_a_thin_wall_does_not_choose_a_side() -> None:
    thin = drawn(*['.' * 20 + '#' + '.' * 20] * 30)
    with pytest.raises(NavigationError) as raised:
        GridPlanner(Costmap(thin, INFLATION)).plan(Pose(1.02, 0.7, 0.0), Pose(1.7, 0.7, 0.0))
    assert raised.value.code == 'START_OCCUPIED'
