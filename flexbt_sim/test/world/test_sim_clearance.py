# SPDX-License-Identifier: BSD-3-Clause
"""Distances on a map against a check of every obstacle."""

from __future__ import annotations

import math
import tracemalloc

import numpy
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from flexbt_sim.world import OccupancyMap, Pose
from flexbt_sim.world.plane.occupancy_map import FAR
from flexbt_testing.worlds import drawn, places, room, worlds

thorough = settings(deadline=None, max_examples=60)


@thorough
@given(st.data(), worlds())
def test_clearance_is_exact_on_the_map_and_beside_it(data: st.DataObject, world: OccupancyMap) -> None:
    for pose in data.draw(st.lists(places(world, beside=30.0), min_size=5, max_size=5)):
        assert world.clearance(pose.x, pose.y) == pytest.approx(room(world, pose.x, pose.y), abs=1e-6)


@thorough
@given(worlds(size=9))
def test_known_distances_are_exact_at_centres_corners_and_edges(world: OccupancyMap) -> None:
    field = world.half_cell_distances
    assert field.shape == (2 * world.height + 1, 2 * world.width + 1)
    for row in range(field.shape[0]):
        for column in range(field.shape[1]):
            distance = room(world, *world.point(row / 2.0 - 0.5, column / 2.0 - 0.5))
            assert field[row, column] == pytest.approx(min(distance, FAR), abs=1e-6)
    assert world.distances.shape == world.cells.shape
    for row, column in ((0, 0), (world.height - 1, world.width - 1)):
        assert world.distances[row, column] == pytest.approx(min(room(world, *world.point(row, column)), FAR), abs=1e-6)


def test_the_largest_maps_have_room_in_memory() -> None:
    """Ten million cells have forty million places: what is told of each is not computed of all at once."""
    world = OccupancyMap(numpy.eye(200, dtype=numpy.int8) * 100, 0.05, Pose(0.0, 0.0, 0.0))
    tracemalloc.start()
    try:
        places = world.half_cell_distances.size
        assert tracemalloc.get_traced_memory()[1] < 16 * places
    finally:
        tracemalloc.stop()


@given(st.data(), worlds())
def test_a_cell_holds_the_points_round_its_centre(data: st.DataObject, world: OccupancyMap) -> None:
    row, column = data.draw(st.integers(-5, 50)), data.draw(st.integers(-5, 50))
    offset = st.floats(-0.499, 0.499)
    assert world.cell(*world.point(row + data.draw(offset), column + data.draw(offset))) == (row, column)
    position = world.grid_position(*world.point(row, column))
    assert position == pytest.approx((row + 0.5, column + 0.5))
    assert world.contains(row, column) == (0 <= row < world.height and 0 <= column < world.width)


def test_without_obstacles_everything_is_free() -> None:
    world = drawn('..?', '???')
    for x, y in ((0.0, 0.0), (0.07, 0.02), (-50.0, 1e6)):
        assert world.clearance(x, y) == math.inf


def test_obstacles_are_what_is_occupied_more_likely_than_not() -> None:
    world = OccupancyMap(numpy.array([[-1, 0, 50, 51]], numpy.int8), 1.0, Pose(0.0, 0.0, 0.0))
    assert world.obstacles.tolist() == [[False, False, False, True]]
