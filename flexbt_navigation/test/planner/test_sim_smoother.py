# SPDX-License-Identifier: BSD-3-Clause
"""Smoothing of paths: what stays, what gets smoother, and what is never entered."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from flexbt_navigation.costmaps.costmap import Costmap, Inflation
from flexbt_navigation.errors import NavigationError
from flexbt_navigation.planner.planners import GridPlanner
from flexbt_navigation.planner.smoother import Smoothing, smooth_path
from flexbt_sim.world import OccupancyMap, Polygon, Pose, wrap
from flexbt_testing.worlds import drawn, free_places, rooms, worlds

OPEN = Costmap(drawn(*['.' * 120] * 120), Inflation())
RADIUS = OPEN.inflation.robot_radius


def ignore() -> None:
    """There is time enough."""


def bends(path: list[Pose]) -> float:
    """Return how much a path bends: the sum of the squares of its second differences."""
    points = numpy.array([pose[:2] for pose in path])
    return float((numpy.diff(points, 2, axis=0) ** 2).sum())


def along(*corners: tuple[float, float], spacing: float = 0.05) -> list[Pose]:
    """Poses along straight lines, each heading to the next."""
    points = []
    for start, end in pairwise(corners):
        count = math.ceil(math.dist(start, end) / spacing)
        parts = numpy.arange(count) / count
        points += [(start[0] + (end[0] - start[0]) * p, start[1] + (end[1] - start[1]) * p) for p in parts.tolist()]
    points.append(corners[-1])
    heads = [math.atan2(b[1] - a[1], b[0] - a[0]) for a, b in pairwise(points)]
    return [Pose(x, y, yaw) for (x, y), yaw in zip(points, [*heads, heads[-1]], strict=True)]


def as_nav2_does(path: list[Pose]) -> list[list[float]]:
    """Nav2's own iteration for a path without obstacles, until nothing moves."""
    data = [list(pose[:2]) for pose in path]
    now = [list(point) for point in data]
    change = 1.0
    while change >= 1e-10:
        change = 0.0
        for i in range(1, len(data) - 1):
            for j in (0, 1):
                step = 0.2 * (data[i][j] - now[i][j]) + 0.3 * (now[i + 1][j] + now[i - 1][j] - 2.0 * now[i][j])
                now[i][j] += step
                change += abs(step)
    return now


def test_it_ends_where_the_iteration_of_nav2_ends() -> None:
    path = along((1.0, 1.0), (2.0, 1.0), (2.0, 2.0), (3.0, 2.5))
    smoothed = smooth_path(path, OPEN, Smoothing(refinements=0), ignore)
    numpy.testing.assert_allclose([pose[:2] for pose in smoothed], as_nav2_does(path), atol=1e-8)


@settings(deadline=None, max_examples=30)
@given(st.data(), worlds(least=15, border=True, resolutions=(0.05, 0.1)), st.integers(0, 5))
def test_a_planned_path_gets_smoother_keeps_its_ends_and_enters_no_obstacle(
    data: st.DataObject, world: OccupancyMap, refinements: int
) -> None:
    anywhere = free_places(world, RADIUS)
    assume(not anywhere.is_empty)
    costmap = Costmap(world, Inflation())
    start, goal = data.draw(anywhere), data.draw(anywhere)
    try:
        path = GridPlanner(costmap).plan(start, goal)
    except NavigationError:
        assume(False)
    smoothed = smooth_path(path, costmap, Smoothing(refinements), ignore)
    assert len(smoothed) == len(path)
    assert smoothed[0][:2] == path[0][:2]
    assert smoothed[-1] == path[-1]
    assert bends(smoothed) <= bends(path) + 1e-9
    room = rooms(world, numpy.array([pose[:2] for pose in smoothed]))
    assert room.min() >= min(RADIUS, rooms(world, numpy.array([pose[:2] for pose in path])).min()) - 1e-6


def test_where_the_robot_reverses_or_turns_on_the_spot_it_still_does() -> None:
    there, back = along((1.0, 1.0), (2.0, 1.0), (2.5, 1.5)), along((2.5, 1.5), (2.0, 1.5), (1.0, 2.0))
    backward = [Pose(x, y, yaw - math.pi) for x, y, yaw in back]
    path = [*there, *backward[1:]]
    smoothed = smooth_path(path, OPEN, Smoothing(), ignore)
    turn = len(there) - 1
    assert smoothed[turn][:2] == there[-1][:2]
    # Backward stays backward.
    heads = [math.cos(math.atan2(b.y - a.y, b.x - a.x) - a.yaw) for a, b in pairwise(smoothed)]
    assert all(head > 0.9 for head in heads[:turn])
    assert all(head < -0.9 for head in heads[turn:])
    on_the_spot = [*along((1.0, 1.0), (2.0, 1.0)), *along((2.0, 1.0), (2.0, 2.0))]
    assert smooth_path(on_the_spot, OPEN, Smoothing(), ignore)[20][:2] == (2.0, 1.0)
    assert smooth_path(on_the_spot, OPEN, Smoothing(keeps_reversals=False), ignore)[20][:2] != (2.0, 1.0)


def test_a_robot_that_is_driven_backward_touches_nothing_with_its_front() -> None:
    """The front of the robot, 0.8 m from its centre, sweeps over an obstacle where the path no longer bends at once."""
    forklift = Inflation.of(Polygon(((0.8, 0.2), (-0.2, 0.2), (-0.2, -0.2), (0.8, -0.2))))
    cells = numpy.zeros((60, 80), numpy.int8)
    cells[12, 26] = 100
    costmap = Costmap(OccupancyMap(cells, 0.05, Pose(0.0, 0.0, 0.0)), forklift)
    bend = along((1.0, 1.0), (2.0, 1.0), (2.0 + math.cos(1.0), 1.0 + math.sin(1.0)))
    path = [pose._replace(yaw=wrap(pose.yaw + math.pi)) for pose in bend]
    assert not any(map(costmap.in_collision, path))
    smoothed = smooth_path(path, costmap, Smoothing(), ignore)
    assert smoothed[19:22] == path[19:22]
    assert not any(map(costmap.in_collision, smoothed))
    assert smooth_path(path, OPEN, Smoothing(), ignore)[20] != path[20]


def test_a_pose_that_is_given_twice_does_not_turn_the_robot_round() -> None:
    west = along((4.0, 1.0), (2.0, 1.0))
    smoothed = smooth_path([*west[:2], *west[1:]], OPEN, Smoothing(), ignore)
    assert all(math.cos(pose.yaw) < -0.99 for pose in smoothed)


def test_a_short_path_stays_as_it_is_and_none_is_invalid() -> None:
    short = along((1.0, 1.0), (1.1, 1.0), (1.1, 1.1))[:4]
    assert smooth_path(short, OPEN, Smoothing(), ignore) == short
    assert smooth_path(short[:1], OPEN, Smoothing(), ignore) == short[:1]
    with pytest.raises(NavigationError) as raised:
        smooth_path([], OPEN, Smoothing(), ignore)
    assert raised.value.code == 'INVALID_PATH'


def test_a_path_that_is_in_an_obstacle_stays_there() -> None:
    """It is not for the smoother to plan round it."""
    walled = Costmap(drawn(*['.' * 60 + '#' + '.' * 59] * 120), Inflation())
    path = along((2.0, 1.0), (4.0, 1.0), (4.0, 2.0))
    smoothed = smooth_path(path, walled, Smoothing(), ignore)
    wall = range(15, 26)
    assert [smoothed[index][:2] for index in wall] == [path[index][:2] for index in wall]
    assert bends(smoothed) < bends(path)


def test_time_that_is_up_ends_it() -> None:
    def up() -> None:
        raise NavigationError('TIMEOUT', 'the time is up')

    with pytest.raises(NavigationError):
        smooth_path(along((1.0, 1.0), (2.0, 1.0), (2.0, 2.0)), OPEN, Smoothing(), up)
