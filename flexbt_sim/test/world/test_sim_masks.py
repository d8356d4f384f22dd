# SPDX-License-Identifier: BSD-3-Clause
"""Masks: shapes drawn on the grid of a map, and a map with the mask of another grid."""

from __future__ import annotations

import math
from itertools import product

import numpy
from hypothesis import given, settings
from hypothesis import strategies as st

from flexbt_sim.world import OCCUPIED, Circle, OccupancyMap, Polygon, Pose, Shape, box, gap
from flexbt_testing.worlds import places, worlds

POINT = Circle(0.001)


def shapes() -> st.SearchStrategy[Shape]:
    side = st.floats(0.002, 5.0)
    ell = Polygon(((1.0, 1.0), (-1.0, 1.0), (-1.0, -1.0), (0.0, -1.0), (0.0, 0.0), (1.0, 0.0)))
    return st.builds(Circle, side) | st.builds(box, side, side) | st.just(ell)


@settings(max_examples=40, deadline=None)
@given(st.data(), worlds(size=15, blocks=0), st.lists(shapes(), min_size=1, max_size=2))
def test_a_mask_is_occupied_where_the_shapes_are(data: st.DataObject, world: OccupancyMap, drawn: list[Shape]) -> None:
    areas = [(shape, data.draw(places(world, beside=5.0))) for shape in drawn]
    mask = world.mask(areas)
    assert (mask.resolution, mask.origin, mask.cells.shape) == (world.resolution, world.origin, world.cells.shape)
    for row, column in product(range(world.height), range(world.width)):
        place = Pose(*world.point(row, column), 0.0)
        away = min(gap(shape, pose, POINT, place) for shape, pose in areas) + POINT.radius
        if away < -0.1 * world.resolution:
            assert mask.obstacles[row, column]
        if away > 1.1 * world.resolution:
            assert not mask.obstacles[row, column]


@given(worlds(size=25), worlds(size=25))
def test_a_masked_map_is_occupied_where_it_was_or_the_mask_is(world: OccupancyMap, mask: OccupancyMap) -> None:
    masked = world.masked(mask)
    for row, column in product(range(world.height), range(world.width)):
        position = mask.grid_position(*world.point(row, column))
        if any(abs(at - round(at)) < 1e-6 for at in position):
            continue  # between two cells either may count
        cell = (math.floor(position[0]), math.floor(position[1]))
        covered = mask.contains(*cell) and mask.obstacles[cell]
        assert masked.cells[row, column] == (OCCUPIED if covered else world.cells[row, column])


@given(worlds())
def test_a_map_masked_with_itself_has_the_same_obstacles(world: OccupancyMap) -> None:
    assert numpy.array_equal(world.masked(world).obstacles, world.obstacles)
