# SPDX-License-Identifier: BSD-3-Clause
"""Costs and clear lines against a check of every obstacle."""

from __future__ import annotations

import math

import numpy
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from flexbt_navigation.costmaps.costmap import INSCRIBED, LETHAL, Costmap, Inflation
from flexbt_sim.errors import SimulationError
from flexbt_sim.world import Circle, OccupancyMap, Polygon, Pose, box, gap
from flexbt_testing.worlds import drawn, places, room, rooms, worlds

inflations = st.builds(
    Inflation, robot_radius=st.floats(0.05, 0.5), radius=st.floats(0.0, 2.0), scaling=st.floats(0.1, 20.0)
)


@settings(deadline=None)
@given(worlds(size=16), inflations)
def test_costs_fall_off_with_the_distance_by_the_law_of_nav2(world: OccupancyMap, inflation: Inflation) -> None:
    costs = Costmap(world, inflation).costs
    for row in range(world.height):
        for column in range(world.width):
            distance, cost = room(world, *world.point(row, column)), int(costs[row, column])
            if min(abs(distance - inflation.robot_radius), abs(distance - inflation.radius)) < 1e-6:
                continue  # on the border both are right
            if distance == 0.0:
                assert cost == LETHAL
            elif distance < inflation.robot_radius:
                assert cost == INSCRIBED
            elif distance > inflation.radius:
                assert cost == 0
            else:
                exact = 252.0 * math.exp(-inflation.scaling * (distance - inflation.robot_radius))
                assert exact - 1.001 < cost <= exact + 0.001


@settings(deadline=None)
@given(st.data(), worlds(), inflations)
def test_a_collision_is_an_overlap_or_a_place_beside_the_map(
    data: st.DataObject, world: OccupancyMap, inflation: Inflation
) -> None:
    costmap = Costmap(world, inflation)
    for pose in data.draw(st.lists(places(world, beside=4.0), min_size=10, max_size=10)):
        distance = room(world, pose.x, pose.y)
        if abs(distance - inflation.robot_radius) > 1e-6:
            beside = not world.contains(*world.cell(pose.x, pose.y))
            assert costmap.in_collision(pose) == (beside or distance < inflation.robot_radius)


@settings(deadline=None)
@given(st.data(), worlds(), inflations, st.floats(0.01, 3.0))
def test_room_is_a_circle_on_the_map_in_which_no_obstacle_is(
    data: st.DataObject, world: OccupancyMap, inflation: Inflation, radius: float
) -> None:
    costmap = Costmap(world, inflation)
    for pose in data.draw(st.lists(places(world, beside=1.0), min_size=10, max_size=10)):
        row, column = (at * world.resolution for at in world.grid_position(pose.x, pose.y))
        height, width = world.height * world.resolution, world.width * world.resolution
        nearest = min(room(world, pose.x, pose.y), row, column, height - row, width - column)
        if abs(nearest - radius) > 1e-6:
            assert costmap.has_room(pose, radius) == (nearest > radius)


@settings(deadline=None, max_examples=50)
@given(st.data(), worlds(size=24), st.floats(0.0, 0.6))
def test_a_clear_line_is_free_all_along_and_one_with_room_is_clear(
    data: st.DataObject, world: OccupancyMap, radius: float
) -> None:
    costmap = Costmap(world, Inflation())
    start, end = data.draw(places(world)), data.draw(places(world))
    parts = numpy.linspace(0.0, 1.0, 1000)[:, None]
    least = rooms(world, (1.0 - parts) * start[:2] + parts * end[:2]).min()
    clear = costmap.is_clear(world.grid_position(*start[:2]), world.grid_position(*end[:2]), radius)
    assert not clear or least >= radius - 1e-6
    assert clear or least < radius + world.resolution


def test_the_mean_cost_of_a_line_is_that_of_the_cells_under_it() -> None:
    world = drawn('#' + '.' * 39, resolution=0.1)
    costmap = Costmap(world, Inflation(robot_radius=0.2, radius=5.0, scaling=1.0))
    assert costmap.mean_cost((0.5, 7.5), (0.5, 7.5)) == costmap.costs[0, 7]
    across = costmap.mean_cost((0.5, 2.5), (0.5, 39.5))
    assert abs(across - costmap.costs[0, 2:40].mean()) < 3.0
    corner = (1.0, 40.0)
    assert costmap.mean_cost(corner, corner) == costmap.costs[0, 39]


def test_unknown_cells_are_free() -> None:
    costmap = Costmap(drawn('..??..'), Inflation())
    assert costmap.costs.tolist() == [[0] * 6]
    assert not costmap.in_collision(Pose(0.12, 0.02, 0.0))


FOOTPRINTS = (box(0.5, 0.3), Polygon(((0.4, 0.0), (-0.2, 0.25), (-0.1, 0.0), (-0.2, -0.25))), box(1.2, 0.1))


@settings(deadline=None, max_examples=40)
@given(st.data(), worlds(size=20, resolutions=(0.05, 0.1)), st.sampled_from(FOOTPRINTS))
def test_a_polygon_collides_with_the_cells_that_it_overlaps(
    data: st.DataObject, world: OccupancyMap, footprint: Polygon
) -> None:
    costmap = Costmap(world, Inflation.of(footprint, radius=0.3))
    cell = box(world.resolution, world.resolution)
    for pose in data.draw(st.lists(places(world, beside=-0.01), min_size=6, max_size=6)):
        centres = [Pose(*world.point(*place), world.origin.yaw) for place in numpy.argwhere(world.obstacles).tolist()]
        least = min((gap(footprint, pose, cell, centre) for centre in centres), default=math.inf)
        if least < -1e-6:
            assert costmap.in_collision(pose)
        elif least > 0.21 * world.resolution:
            assert not costmap.in_collision(pose)


def test_a_footprint_has_its_centre_inside() -> None:
    assert Inflation.of(Circle(0.3)) == Inflation(0.3)
    inflation = Inflation.of(box(0.5, 0.3))
    assert inflation.robot_radius == pytest.approx(0.15)
    assert inflation.outer_radius == pytest.approx(math.hypot(0.25, 0.15))
    with pytest.raises(SimulationError, match='centre'):
        Inflation.of(Polygon(((1.0, 1.0), (2.0, 1.0), (2.0, 2.0))))
