# SPDX-License-Identifier: BSD-3-Clause
"""Costmap and planner against slow, independent computations."""

from __future__ import annotations

import heapq
import math
import random
from collections.abc import Iterator, Sequence
from itertools import pairwise

import numpy
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from sim_maps import cluttered, drawn, free_pose

from flexbt_sim.costmap import INSCRIBED, LETHAL, Costmap, Inflation
from flexbt_sim.errors import NavigationError
from flexbt_sim.geometry import Pose
from flexbt_sim.planner import COST_FACTOR, NEUTRAL_COST, SPACING, GridPlanner

INFLATION = Inflation()
MARGIN = 0.02


def neighbours(costmap: Costmap, row: int, column: int) -> Iterator[tuple[int, int, float]]:
    """Cells that the robot can go to, and what that costs; diagonally only where both corners are free."""

    def free(r: int, c: int) -> bool:
        return costmap.world.contains(r, c) and costmap.costs[r, c] < INSCRIBED

    for dr in (-1, 0, 1):
        for dc in (-1, 0, 1):
            r, c = row + dr, column + dc
            if (dr, dc) == (0, 0) or not free(r, c):
                continue
            if dr and dc and not (free(row + dr, column) and free(row, column + dc)):
                continue
            mean = NEUTRAL_COST + COST_FACTOR * (float(costmap.costs[row, column]) + float(costmap.costs[r, c])) / 2
            yield r, c, math.hypot(dr, dc) * mean


def cheapest(costmap: Costmap, start: tuple[int, int], goal: tuple[int, int]) -> float:
    """Cost of the best way over the cells; infinite when there is none."""
    best = {start: 0.0}
    queue = [(0.0, start)]
    while queue:
        cost, cell = heapq.heappop(queue)
        if cell == goal:
            return cost
        if cost > best[cell]:
            continue
        for row, column, step in neighbours(costmap, *cell):
            if cost + step < best.get((row, column), math.inf):
                best[row, column] = cost + step
                heapq.heappush(queue, (cost + step, (row, column)))
    return math.inf


def cost_of(costmap: Costmap, path: Sequence[Pose]) -> float:
    """What driving along a path costs, by the law of the planner."""
    total = 0.0
    for here, ahead in pairwise(path):
        middle = costmap.cost((here.x + ahead.x) / 2, (here.y + ahead.y) / 2)
        assert middle is not None
        total += here.distance(ahead) / costmap.world.resolution * (NEUTRAL_COST + COST_FACTOR * middle)
    return total


@pytest.mark.parametrize('seed', range(6))
def test_inflation_is_the_distance_to_the_nearest_obstacle(seed: int) -> None:
    world = cluttered(seed, size=40, blocks=5)
    costmap = Costmap(world, INFLATION)
    obstacles = numpy.argwhere(world.obstacles)
    for row in range(0, 40, 3):
        for column in range(0, 40, 3):
            distance = max(
                0.0, float(numpy.hypot(*(obstacles - (row, column)).T).min()) * world.resolution - world.resolution / 2
            )
            cost = costmap.costs[row, column]
            if world.obstacles[row, column]:
                assert cost == LETHAL
            elif distance < INFLATION.robot_radius - 1e-6:
                assert cost == INSCRIBED
            elif distance > INFLATION.radius + 1e-6:
                assert cost == 0
            elif abs(distance - INFLATION.robot_radius) > 1e-6 and abs(distance - INFLATION.radius) > 1e-6:
                expected = 252.0 * math.exp(-INFLATION.scaling * (distance - INFLATION.robot_radius))
                assert abs(cost - expected) <= 1.0


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 10**6))
def test_plans_are_free_and_as_cheap_as_the_best_way(seed: int) -> None:
    chance = random.Random(seed)
    world = cluttered(seed, size=60, blocks=chance.randint(3, 14))
    costmap = Costmap(world, INFLATION)
    room = INFLATION.robot_radius + MARGIN
    start, goal = free_pose(world, chance, room), free_pose(world, chance, room)
    if start is None or goal is None:
        return
    best = cheapest(costmap, world.cell(start.x, start.y), world.cell(goal.x, goal.y))
    try:
        path = GridPlanner(costmap).plan(start, goal)
    except NavigationError as error:
        assert error.code == 'NO_VALID_PATH'
        assert best == math.inf
        return
    assert best < math.inf
    assert path[0][:2] == start[:2]
    assert path[-1] == goal
    for here, ahead in pairwise(path):
        assert here.distance(ahead) <= SPACING + 1e-9
        for part in numpy.linspace(0.0, 1.0, 6):
            x, y = here.x + part * (ahead.x - here.x), here.y + part * (ahead.y - here.y)
            assert world.clearance(x, y) > INFLATION.robot_radius - world.resolution
    # The ends lie beside the centres of their cells, by up to 0.71 cells each.
    assert cost_of(costmap, path) <= 1.05 * best + 2.0 * (NEUTRAL_COST + COST_FACTOR * 252.0)


def test_any_angle_in_the_open() -> None:
    world = drawn(*['.' * 100] * 60)
    start, goal = Pose(0.5, 0.5, 0.0), Pose(4.5, 2.0, 1.0)
    path = GridPlanner(Costmap(world, INFLATION)).plan(start, goal)
    length = sum(a.distance(b) for a, b in pairwise(path))
    assert length == pytest.approx(start.distance(goal), rel=0.01)


ROOM = drawn(
    '##############################',
    *['#............##............?.#'] * 12,
    '##############################',
    resolution=0.1,
)


@pytest.mark.parametrize(
    ('start', 'goal', 'code'),
    [
        (Pose(-1.0, 0.5, 0.0), Pose(0.6, 0.7, 0.0), 'START_OUTSIDE_MAP'),
        (Pose(0.6, 0.7, 0.0), Pose(0.6, 9.0, 0.0), 'GOAL_OUTSIDE_MAP'),
        (Pose(0.6, 0.7, 0.0), Pose(1.35, 0.7, 0.0), 'GOAL_OCCUPIED'),
        (Pose(0.6, 0.7, 0.0), Pose(0.15, 0.7, 0.0), 'GOAL_OCCUPIED'),
        (Pose(0.6, 0.7, 0.0), Pose(2.2, 0.7, 0.0), 'NO_VALID_PATH'),
    ],
)
def test_error_codes_of_nav2(start: Pose, goal: Pose, code: str) -> None:
    with pytest.raises(NavigationError) as raised:
        GridPlanner(Costmap(ROOM, INFLATION)).plan(start, goal)
    assert raised.value.code == code


def test_a_robot_that_touches_a_wall_gets_away_and_one_deep_in_it_does_not() -> None:
    planner = GridPlanner(Costmap(ROOM, INFLATION))
    assert planner.plan(Pose(0.25, 0.7, 0.0), Pose(0.9, 0.7, 0.0))
    thick = drawn(*['#' * 20 + '.' * 20] * 30)
    with pytest.raises(NavigationError) as raised:
        GridPlanner(Costmap(thick, INFLATION)).plan(Pose(0.3, 0.7, 0.0), Pose(1.7, 0.7, 0.0))
    assert raised.value.code == 'START_OCCUPIED'


def test_start_and_goal_in_one_place() -> None:
    path = GridPlanner(Costmap(ROOM, INFLATION)).plan(Pose(0.6, 0.7, 0.0), Pose(0.6, 0.7, 2.0))
    assert path[-1] == (0.6, 0.7, 2.0)
    assert all(math.isfinite(value) for pose in path for value in pose)
