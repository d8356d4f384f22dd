# SPDX-License-Identifier: BSD-3-Clause
"""Plans for a car: it can drive them, touches nothing, and finds them wherever it could have driven."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from interpreted import interpret

from flexbt_navigation.controller.motions import Steering
from flexbt_navigation.controller.path_follower import drivable_legs
from flexbt_navigation.costmaps.costmap import Costmap, Inflation
from flexbt_navigation.errors import NavigationError
from flexbt_navigation.navigator import Navigator
from flexbt_navigation.planner import hybrid_kernels, planners
from flexbt_navigation.planner.hybrid_kernels import curves, hybrid_search, ways_to
from flexbt_navigation.planner.planners import STEERING_RESERVE, HybridPlanner, StopFlag
from flexbt_navigation.preparation import prepare_navigation
from flexbt_sim.world import MODELS, OccupancyMap, Polygon, Pose, World, wrap

CAR = MODELS['car']
assert isinstance(CAR.footprint, Polygon)
CORNERS = CAR.footprint.corners
RADIUS = CAR.drive.turning_radius
WIDE = RADIUS * STEERING_RESERVE


def yard(blocks: Sequence[tuple[float, float, float, float]], resolution: float = 0.2) -> Costmap:
    """40 m by 30 m within walls; blocks by row, column, height and width, in metres."""
    cells = numpy.zeros((round(30 / resolution), round(40 / resolution)), numpy.int8)
    cells[0] = cells[-1] = cells[:, 0] = cells[:, -1] = 100
    for block in blocks:
        row, column, height, width = (round(side / resolution) for side in block)
        cells[row : row + height, column : column + width] = 100
    return Costmap(OccupancyMap(cells, resolution, Pose(-20.0, -15.0, 0.0)), Inflation.of(CAR.footprint))


def check(costmap: Costmap, path: Sequence[Pose], start: Pose, goal: Pose, reverses: bool = True) -> None:
    """From start to goal, in bends that the car can drive, touching nothing."""
    assert (path[0], path[-1]) == (start, goal)
    legs = drivable_legs(path, WIDE)
    assert legs or start == goal
    assert reverses or not any(leg.backward for leg in legs)
    assert not any(map(costmap.in_collision, path))


@settings(deadline=None, max_examples=100)
@given(*[st.floats(-8.0, 8.0)] * 2, st.floats(-7.0, 7.0), st.booleans())
def test_curves_end_where_they_are_to(x: float, y: float, yaw: float, reverses: bool) -> None:
    found = curves(x, y, yaw, reverses)
    assert len(found)
    for turns, lengths in zip(found[:, :3].tolist(), found[:, 3:6].tolist(), strict=True):
        assert reverses or min(lengths) >= 0.0
        there = (0.0, 0.0, 0.0)
        for turn, length in zip(turns, lengths, strict=True):
            there = hybrid_kernels.moved(*there, turn, length, 1.0)
        assert math.dist(there[:2], (x, y)) < 1e-9
        assert abs(wrap(there[2] - yaw)) < 1e-9


block = st.tuples(st.integers(1, 28), st.integers(1, 38), st.integers(1, 5), st.integers(1, 6))


@settings(deadline=None, max_examples=12)
@given(
    st.lists(block, max_size=14),
    st.tuples(st.floats(-14.0, 14.0), st.floats(-9.0, 9.0), st.floats(-3.1, 3.1)),
    st.lists(st.tuples(st.sampled_from([-1.0, 0.0, 1.0]), st.floats(-6.0, 9.0)), min_size=1, max_size=8),
    st.sampled_from([0.1, 0.25]),
)
def test_there_is_a_plan_to_wherever_a_car_has_driven(
    blocks: list[tuple[int, int, int, int]],
    begin: tuple[float, float, float],
    pieces: list[tuple[float, float]],
    resolution: float,
) -> None:
    costmap = yard(blocks, resolution)
    start = here = Pose(*begin)
    larger = tuple((x + math.copysign(0.3, x), y + math.copysign(0.3, y)) for x, y in CORNERS)
    roomy = Costmap(costmap.world, Inflation.of(Polygon(larger)))
    assume(not roomy.in_collision(start))
    for turn, length in pieces:
        for _ in range(math.ceil(abs(length) / 0.25)):
            there = Pose(*hybrid_kernels.moved(*here, turn, math.copysign(0.25, length), 1.2 * WIDE))
            if roomy.in_collision(there):
                break
            here = there
    assume(max(start.distance(here), abs(wrap(start.yaw - here.yaw))) > 1e-9)  # otherwise it is there already
    check(costmap, HybridPlanner(costmap, Steering(RADIUS)).plan(start, here), start, here)


def test_a_car_can_be_moved_by_the_room_that_it_has() -> None:
    random = numpy.random.default_rng(3)
    roomy = 0
    for _ in range(5):
        costmap = yard([(r, c, h, w) for r, c, h, w in random.integers((1, 1, 2, 2), (29, 39, 6, 7), (9, 4)).tolist()])
        planner = HybridPlanner(costmap, Steering(RADIUS))
        for x, y, yaw, direction in random.uniform((-19, -14, -3.1, -3.1), (19, 14, 3.1, 3.1), (200, 4)).tolist():
            room = 0.2 * hybrid_kernels.room(planner.shape, 0.25, *planner.on_grid(Pose(x, y, yaw)))
            if room >= 0.0:
                roomy += 1
                assert not costmap.in_collision(Pose(x, y, yaw))
                assert not costmap.in_collision(Pose(x, y, yaw + room / costmap.inflation.outer_radius))
                there = Pose(x + room * math.cos(direction), y + room * math.sin(direction), yaw)
                assert not costmap.in_collision(there)
    assert roomy > 100


LANE = ((0, 0, 12, 40), (18, 0, 12, 40))
"""A lane of 6 m between two blocks."""


def test_a_car_that_may_not_reverse_is_told_that_there_is_no_way() -> None:
    narrow = yard(((0, 0, 13.4, 40), (16.6, 0, 13.4, 40), (0, 0, 30, 10), (0, 30, 30, 10)))
    start, goal = Pose(-5.0, 0.0, 0.0), Pose(5.0, 0.0, 0.0)
    forward = HybridPlanner(narrow, Steering(RADIUS, reverses=False))
    check(narrow, forward.plan(start, goal), start, goal, reverses=False)
    with pytest.raises(NavigationError, match='without driving backward') as raised:
        forward.plan(goal, start)
    assert raised.value.code == 'NO_VALID_PATH'
    check(narrow, HybridPlanner(narrow, Steering(RADIUS)).plan(goal, start), goal, start)
    lane, back = yard(LANE), Pose(-5.0, 0.0, math.pi)
    check(lane, HybridPlanner(lane, Steering(RADIUS)).plan(start, back), start, back)


@pytest.mark.parametrize('reverses', [True, False])
@pytest.mark.parametrize('radius', [0.3, 5.0, 100.0])
def test_every_car_is_prepared_for(radius: float, reverses: bool) -> None:
    """Otherwise its node does not start."""
    prepare_navigation(Steering(radius, reverses), Inflation.of(CAR.footprint))


def test_a_start_or_goal_that_only_another_heading_fits_has_a_code() -> None:
    costmap = yard(LANE)
    along, across = Pose(-8.0, 0.0, 0.0), Pose(8.0, 0.0, math.pi / 2.0)
    for start, goal, code in ((along, across, 'GOAL_OCCUPIED'), (across, along, 'START_OCCUPIED')):
        with pytest.raises(NavigationError) as raised:
            HybridPlanner(costmap, Steering(RADIUS)).plan(start, goal)
        assert raised.value.code == code


def test_a_search_ends_when_it_is_stopped() -> None:
    stop = StopFlag()
    stop.set()
    wall = yard(((14, 0, 1, 40),))
    shape = HybridPlanner(wall, Steering(RADIUS)).shape, 0.25, 1.0
    ends = (100.0, 40.0, 0.0), (100.0, 110.0, 0.0)
    ways = ways_to(numpy.ones(wall.obstacles.shape, bool), 100, 110, 75.0, 1)
    pieces, states = hybrid_search(*shape, ways, *ends, 25.0, 4.0, True, 100_000, stop.cell)
    assert len(pieces) == 0
    assert 1 < states < 1000


@pytest.fixture
def states(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """Return how many each search has looked at."""
    compiled, looked = hybrid_search.compiled or hybrid_search.interpreted, []

    def search(*problem: Any) -> Any:
        pieces, states = compiled(*problem)
        looked.append(states)
        return pieces, states

    monkeypatch.setattr(hybrid_search, 'compiled', search)
    return looked


def test_a_turn_at_either_end_is_estimated_from_afar(states: list[int]) -> None:
    """What is not estimated is looked at everywhere between: 265 states."""
    costmap = yard(((13, 18, 4, 4),))
    start, goal = Pose(-14.0, 0.0, math.pi), Pose(14.0, 0.0, math.pi)
    check(costmap, HybridPlanner(costmap, Steering(RADIUS)).plan(start, goal), start, goal)
    assert sum(states) < 120


def test_a_goal_that_is_hard_to_get_to_is_searched_for_from_there(states: list[int]) -> None:
    """From the start alone it is 24,000 states."""
    costmap = yard(((0, 20, 26, 1), (10, 22, 1, 12), (5, 20, 1, 12)))
    start, goal = Pose(-14.0, -5.0, 0.0), Pose(9.0, -7.5, 0.0)
    check(costmap, HybridPlanner(costmap, Steering(RADIUS)).plan(start, goal), start, goal)
    assert sum(states) < 12_000


def test_ends_that_are_both_hard_to_get_to_are_joined_where_there_is_room(states: list[int]) -> None:
    """From either end alone it is 212,000 states, and no way is found."""
    costmap = yard(((0, 20, 24, 1), (10, 24, 1, 16), (5, 21, 1, 12), (10, 0, 1, 16), (5, 8, 1, 12)))
    start, goal = Pose(-9.0, -7.0, 0.0), Pose(9.0, -7.0, 0.0)
    check(costmap, HybridPlanner(costmap, Steering(RADIUS)).plan(start, goal), start, goal)
    assert sum(states) < 20_000


def test_a_car_gets_out_of_a_space_between_two_others_and_into_it() -> None:
    """No piece of the usual length can be driven there."""
    costmap = yard(((0, 0, 14, 40), (21, 0, 9, 40), (14, 10, 2.4, 6), (14, 22.2, 2.4, 6)))
    parked, away = Pose(-2.5, 0.25, 0.0), Pose(12.0, 2.5, 0.0)
    planner = HybridPlanner(costmap, Steering(RADIUS))
    for start, goal in ((parked, away), (away, parked)):
        check(costmap, planner.plan(start, goal), start, goal)


def test_the_rest_of_a_path_is_the_plan_as_long_as_it_is_free() -> None:
    costmap = yard(())
    start, goal = Pose(-12.0, 0.0, 0.0), Pose(12.0, 4.0, 1.0)
    path = HybridPlanner(costmap, Steering(RADIUS)).plan(start, goal)
    here = path[100]._replace(y=path[100].y + 0.1)
    planner = HybridPlanner(costmap, Steering(RADIUS))
    assert planner.plan(here, goal, before=[path]) == path[100:]
    aside = here._replace(y=here.y + 2.0)
    check(costmap, planner.plan(aside, goal, before=[path]), aside, goal)
    blocked = yard(((15, 24, 2, 2),))
    assert any(map(blocked.in_collision, path[100:]))
    check(blocked, HybridPlanner(blocked, Steering(RADIUS)).plan(here, goal, before=[path]), here, goal)


def test_a_goal_on_the_way_that_has_moved_a_little_is_met_where_it_is_now() -> None:
    """Of the way before, only what begins at the robot is gone on with; the leg after it begins at its goal."""
    costmap = yard(())
    planner = HybridPlanner(costmap, Steering(RADIUS))
    start, middle, goal = Pose(-12.0, 0.0, 0.0), Pose(0.0, 0.0, 0.0), Pose(12.0, 4.0, 1.0)
    before = planner.plan_through(start, [middle, goal])
    here = start._replace(y=0.1)
    assert planner.plan_through(here, [middle, goal], before=before) == before
    moved = middle._replace(y=0.2)
    legs = planner.plan_through(here, [moved, goal], before=before)
    for leg, begin, end in zip(legs, (here, moved), (moved, goal), strict=True):
        check(costmap, leg, begin, end)


def test_a_search_that_is_not_compiled_is_given_up_earlier(monkeypatch: pytest.MonkeyPatch) -> None:
    interpret(monkeypatch, hybrid_kernels)
    monkeypatch.setattr(planners, 'MOST_STATES_INTERPRETED', (10, 30))
    planner = HybridPlanner(yard(LANE, 0.5), Steering(RADIUS, reverses=False))
    with pytest.raises(NavigationError, match='of 80 places') as raised:
        planner.plan(Pose(-8.0, 0.0, 0.0), Pose(-8.0, 0.0, math.pi))
    assert raised.value.code == 'TIMEOUT'


def test_a_car_turns_round_where_it_needs_several_moves() -> None:
    costmap = yard(((0, 0, 9, 40), (19, 0, 11, 40)))
    world = World(costmap.world)
    start, goal = Pose(-6.0, -1.0, 0.0), Pose(-4.0, -1.0, math.pi)
    car = world.add('car', CAR, start)
    trip = Navigator(world, 'car', costmap).navigate(goal, timeout=200.0)
    assert (trip.code, trip.contacts, trip.recoveries) == ('', 0, 0), trip.errors
    assert car.pose.distance(goal) <= 0.25
    assert abs(wrap(car.pose.yaw - goal.yaw)) <= 0.25
