# SPDX-License-Identifier: BSD-3-Clause
"""Plans for robots that are no circles and turn on the spot: the outline has room, and they are found."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise

import numpy
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from interpreted import interpret

from flexbt_navigation.controller.motions import Steering
from flexbt_navigation.costmaps.costmap import Costmap, Inflation
from flexbt_navigation.errors import NavigationError
from flexbt_navigation.navigator import Navigator
from flexbt_navigation.planner import hybrid_kernels, planners
from flexbt_navigation.planner.planners import GridPlanner, OutlinePlanner, planner_for
from flexbt_sim.world import MODELS, OccupancyMap, Polygon, Pose, World, box, wrap

LONG = box(0.9, 0.4)
WEDGE = Polygon(((0.30, 0.12), (-0.25, 0.24), (-0.25, -0.24), (0.30, -0.12)))


def floor_of(
    blocks: Sequence[tuple[float, float, float, float]], footprint: Polygon = LONG, resolution: float = 0.05
) -> Costmap:
    """5 m by 4 m within walls; blocks by row, column, height and width, in metres."""
    cells = numpy.zeros((round(4.0 / resolution), round(5.0 / resolution)), numpy.int8)
    cells[0] = cells[-1] = cells[:, 0] = cells[:, -1] = 100
    for block in blocks:
        row, column, height, width = (round(side / resolution) for side in block)
        cells[row : row + height, column : column + width] = 100
    return Costmap(OccupancyMap(cells, resolution, Pose(0.0, 0.0, 0.0)), Inflation.of(footprint))


def turn(costmap: Costmap, pose: Pose, yaw: float) -> bool:
    """Return whether the robot has room to turn on the spot to a heading, the shorter way round."""
    parts = numpy.linspace(0.0, wrap(yaw - pose.yaw), 20)[1:].tolist()
    return not any(costmap.in_collision(pose._replace(yaw=pose.yaw + part)) for part in parts)


def is_drivable(costmap: Costmap, path: Sequence[Pose], start: Pose) -> bool:
    """By a robot that turns to where the path leads, and last to the heading of the goal, and goes straight."""
    return (
        turn(costmap, start, path[0].yaw)
        and all(turn(costmap, there._replace(yaw=here.yaw), there.yaw) for here, there in pairwise(path))
        and not any(map(costmap.in_collision, path[1:]))
    )


def check(costmap: Costmap, path: Sequence[Pose], start: Pose, goal: Pose) -> None:
    assert (path[0][:2], path[-1]) == (start[:2], goal)
    assert is_drivable(costmap, path, start)


blocks = st.lists(
    st.tuples(st.floats(0.2, 3.6), st.floats(0.2, 4.6), st.floats(0.1, 1.2), st.floats(0.1, 1.2)), max_size=9
)
moves = st.lists(st.tuples(st.floats(-2.5, 2.5), st.floats(0.0, 3.0)), min_size=1, max_size=8)


@settings(deadline=None, max_examples=15)
@given(
    blocks, st.tuples(st.floats(0.3, 4.7), st.floats(0.3, 3.7), st.floats(-3.1, 3.1)), moves,
    st.sampled_from([LONG, WEDGE]), st.sampled_from([0.05, 0.1]),
)  # fmt: skip
def test_there_is_a_plan_to_wherever_a_robot_has_driven(
    walls: list[tuple[float, float, float, float]],
    begin: tuple[float, float, float],
    driven: list[tuple[float, float]],
    footprint: Polygon,
    resolution: float,
) -> None:
    """One that is a little larger, so that the cells do not decide; and the plan has room for this one."""
    costmap = floor_of(walls, footprint, resolution)
    larger = Polygon(
        tuple((x + math.copysign(resolution, x), y + math.copysign(resolution, y)) for x, y in footprint.corners)
    )
    roomy = Costmap(costmap.world, Inflation.of(larger))
    start = here = Pose(*begin)
    assume(not roomy.in_collision(start))
    for angle, length in driven:
        if turn(roomy, here, here.yaw + angle):
            here = here._replace(yaw=here.yaw + angle)
        for _ in range(round(length / 0.05)):
            there = here._replace(x=here.x + 0.05 * math.cos(here.yaw), y=here.y + 0.05 * math.sin(here.yaw))
            if roomy.in_collision(there):
                break
            here = there
    check(costmap, planner_for(costmap, Steering()).plan(start, here), start, here)


CORRIDOR = floor_of(((0.0, 0.0, 1.7, 3.0), (2.3, 0.0, 1.7, 3.0)))
"""0.6 m wide, into a room: the robot cannot turn in it."""
INTO, OUT_OF = Pose(1.0, 2.0, math.pi), Pose(1.0, 2.0, 0.0)


def test_a_robot_that_cannot_turn_in_a_corridor_turns_in_the_room_at_its_end() -> None:
    path = OutlinePlanner(CORRIDOR).plan(OUT_OF, INTO)
    check(CORRIDOR, path, OUT_OF, INTO)
    assert max(pose.x for pose in path) > 3.2
    assert not is_drivable(CORRIDOR, GridPlanner(CORRIDOR).plan(OUT_OF, INTO), OUT_OF)


@pytest.mark.parametrize(
    ('start', 'goal'),
    [
        (Pose(1.34, 2.01, -0.04), Pose(1.82, 1.96, 0.12)),  # a single straight line
        (Pose(0.75, 1.95, -0.04), Pose(1.17, 1.99, 0.17)),  # begins with a turn
    ],
)
def test_a_short_way_in_a_corridor(start: Pose, goal: Pose) -> None:
    check(CORRIDOR, OutlinePlanner(CORRIDOR).plan(start, goal), start, goal)


def test_where_it_cannot_get_the_right_way_round_there_is_no_path() -> None:
    """It drives forward, and so it can neither leave the corridor backward nor come into it that way."""
    room = Pose(4.0, 2.0, 0.0)
    planner = OutlinePlanner(CORRIDOR)
    for start, goal in ((INTO, room), (room, OUT_OF)):
        with pytest.raises(NavigationError, match='no way with room for the outline') as raised:
            planner.plan(start, goal)
        assert raised.value.code == 'NO_VALID_PATH'
    check(CORRIDOR, planner.plan(room, INTO), room, INTO)


def test_where_only_a_circle_gets_round_a_bend_another_way_is_taken() -> None:
    """Two walls 0.45 m apart, with doors that are not opposite each other; at their end there is room."""
    walls = ((0.0, 2.0, 1.0, 0.1), (1.6, 2.0, 1.4, 0.1), (0.0, 2.55, 0.3, 0.1), (0.9, 2.55, 2.1, 0.1))
    costmap = floor_of((*walls, (2.9, 2.0, 0.1, 0.65)))
    start, goal = Pose(1.0, 1.3, 0.0), Pose(4.0, 0.6, 0.0)
    circle = GridPlanner(costmap).plan(start, goal)
    assert max(pose.y for pose in circle) < 2.0
    assert not is_drivable(costmap, circle, start)
    check(costmap, planner_for(costmap, Steering()).plan(start, goal), start, goal)


def test_the_rest_of_a_path_is_the_plan_as_long_as_it_has_room() -> None:
    path = OutlinePlanner(CORRIDOR).plan(OUT_OF, INTO)
    here = path[20]._replace(y=path[20].y + 0.02)
    planner = OutlinePlanner(CORRIDOR)
    assert planner.plan(here, INTO, before=[path]) == path[20:]
    aside = Pose(4.0, 3.0, 0.0)
    check(CORRIDOR, planner.plan(aside, INTO, before=[path]), aside, INTO)


def test_a_search_that_is_given_up_leaves_the_path_of_a_circle(monkeypatch: pytest.MonkeyPatch) -> None:
    interpret(monkeypatch, hybrid_kernels)
    monkeypatch.setattr(planners, 'MOST_OUTLINES_INTERPRETED', (10, 20))
    assert OutlinePlanner(CORRIDOR).plan(OUT_OF, INTO) == GridPlanner(CORRIDOR).plan(OUT_OF, INTO)


def test_a_robot_arrives_where_its_outline_decides_the_way() -> None:
    world = World(CORRIDOR.world)
    goal = Pose(1.3, 2.0, math.pi)
    robot = world.add('robot', replace(MODELS['waffle'], footprint=LONG), Pose(1.5, 2.0, 0.0))
    trip = Navigator(world, 'robot', CORRIDOR).navigate(goal, timeout=120.0)
    assert (trip.code, trip.contacts, trip.recoveries) == ('', 0, 0), trip.errors
    assert robot.pose.distance(goal) <= 0.25
