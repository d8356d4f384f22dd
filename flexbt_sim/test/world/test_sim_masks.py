# SPDX-License-Identifier: BSD-3-Clause
"""Masks: shapes drawn on the grid of a map, and a map with the mask of another grid."""

from __future__ import annotations

import math
from itertools import product

import numpy
import scipy
from hypothesis import given, settings
from hypothesis import strategies as st

from flexbt_sim.world import OCCUPIED, Circle, OccupancyMap, Polygon, Pose, Shape, box, gap
from flexbt_testing.worlds import places, worlds

ROUNDED = 0.007
"""Distance, m, from a circle of 5 m to the polygon that stands for it on a grid."""


def shapes() -> st.SearchStrategy[Shape]:
    side = st.floats(0.002, 5.0) | st.just(0.002)
    ell = Polygon(((1.0, 1.0), (-1.0, 1.0), (-1.0, -1.0), (0.0, -1.0), (0.0, 0.0), (1.0, 0.0)))
    return st.builds(Circle, side) | st.builds(box, side, side) | st.just(ell)


@settings(max_examples=40, deadline=None)
@given(st.data(), worlds(size=15, blocks=0), st.lists(shapes(), min_size=1, max_size=2))
def test_a_mask_is_occupied_where_the_shapes_are(data: st.DataObject, world: OccupancyMap, drawn: list[Shape]) -> None:
    areas = [(shape, data.draw(places(world, beside=5.0))) for shape in drawn]
    mask = world.mask(areas)
    assert (mask.resolution, mask.origin, mask.cells.shape) == (world.resolution, world.origin, world.cells.shape)
    cell = box(world.resolution, world.resolution)
    for row, column in product(range(world.height), range(world.width)):
        place = Pose(*world.point(row, column), world.origin.yaw)
        away = min(gap(shape, pose, cell, place) for shape, pose in areas)
        if away < -ROUNDED:
            assert mask.obstacles[row, column]
        if away > ROUNDED:
            assert not mask.obstacles[row, column]


@given(st.floats(-0.5, 0.5), st.floats(0.001, 0.1))
def test_a_thin_area_has_no_holes(yaw: float, thickness: float) -> None:
    """No path leads through a line that robots have to keep out of."""
    world = OccupancyMap(numpy.zeros((120, 120), numpy.int8), 0.05, Pose(0.0, 0.0, 0.0))
    mask = world.mask([(box(20.0, thickness), Pose(3.0, 3.0, yaw))])
    regions, count = scipy.ndimage.label(~mask.obstacles)
    assert (count, regions[0, 60] == regions[-1, 60]) == (2, False)


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
