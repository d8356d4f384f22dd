# SPDX-License-Identifier: BSD-3-Clause
"""Costmaps that follow what a lidar sees, against costmaps that are made anew."""

from __future__ import annotations

import math
from dataclasses import replace

import array_forms
import numpy
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from flexbt_navigation.costmaps import kernels
from flexbt_navigation.costmaps.costmap import Costmap, Inflation
from flexbt_navigation.costmaps.layers import LayeredCostmap, Observation, known_tolerance, local_size
from flexbt_sim.world import MODELS, OCCUPIED, LidarModel, OccupancyMap, Pose, compose, drive
from flexbt_testing.worlds import Scanner, drawn, worlds

INFLATION = Inflation(robot_radius=0.2, radius=0.5)
MODEL = LidarModel(beams=360, range_max=3.5, noise=0.0)
EMPTY = drawn(*['.' * 120] * 120)
ROBOT = Pose(3.0, 3.0, 0.4)


def with_block(world: OccupancyMap, x: float, y: float, size: float = 0.3) -> OccupancyMap:
    """Return the map, and a square about a point."""
    cells = world.cells.copy()
    row, column = world.cell(x - size / 2.0, y - size / 2.0)
    cells[row : row + round(size / world.resolution), column : column + round(size / world.resolution)] = OCCUPIED
    return OccupancyMap(cells, world.resolution, world.origin)


def seen(world: OccupancyMap, robot: Pose, model: LidarModel = MODEL, seed: int = 0) -> Observation:
    """Return what a lidar on the robot sees."""
    angles = numpy.arange(model.beams, dtype=numpy.float64) * model.angle_increment
    return Observation(robot, angles, Scanner(world, model, seed).scan(robot).astype(numpy.float64), model.range_max)


def layered(world: OccupancyMap = EMPTY, window: float = math.inf, noise: float = 0.0) -> LayeredCostmap:
    return LayeredCostmap(Costmap(world, INFLATION), window, known_tolerance(LidarModel(noise=noise)))


def marks(layers: LayeredCostmap) -> set[tuple[int, int]]:
    """Return the cells that are obstacles, and are none on the map."""
    rows, columns = numpy.nonzero(layers.costmap.obstacles & ~layers.costmap.world.obstacles)
    return set(zip(rows.tolist(), columns.tolist(), strict=True))


def test_what_appears_is_marked_and_what_has_gone_is_cleared() -> None:
    layers = layered()
    layers.observe(seen(with_block(EMPTY, 4.5, 3.0), ROBOT), ROBOT)
    assert marks(layers)
    assert layers.costmap.in_collision(Pose(4.35, 3.0, 0.0))
    assert not layers.costmap.in_collision(Pose(4.1, 3.0, 0.0))
    layers.observe(seen(EMPTY, ROBOT), ROBOT)
    assert not marks(layers)
    assert (layers.costmap.costs == 0).all()


def test_beyond_the_obstacle_range_nothing_is_marked_and_beyond_the_raytrace_range_nothing_cleared() -> None:
    layers = layered()
    layers.observe(seen(with_block(EMPTY, 5.8, 3.0), ROBOT), ROBOT)
    assert not marks(layers)
    near = Pose(5.0, 3.0, 0.0)
    layers.observe(seen(with_block(EMPTY, 5.8, 3.0), near), near)
    known = marks(layers)
    assert known
    between = Pose(2.9, 3.0, 0.0)  # it is seen there, and not marked
    layers.observe(seen(with_block(EMPTY, 5.8, 3.0), between), between)
    assert marks(layers) == known
    far = Pose(2.4, 3.0, 0.0)
    layers.observe(seen(EMPTY, far), far)
    assert marks(layers) == known
    closer = Pose(3.2, 3.0, 0.0)
    layers.observe(seen(EMPTY, closer), closer)
    assert not marks(layers)


def test_what_is_not_measured_changes_nothing() -> None:
    layers = layered()
    layers.observe(seen(with_block(EMPTY, 4.5, 3.0), ROBOT), ROBOT)
    known = marks(layers)
    for nothing in (math.nan, -math.inf):
        layers.observe(Observation(ROBOT, numpy.linspace(0.0, 6.0, 90), numpy.full(90, nothing), 3.5), ROBOT)
        assert marks(layers) == known


@pytest.mark.parametrize('noise', [0.01, 0.03])
def test_the_walls_of_the_map_are_not_marked_again_by_a_noisy_lidar(noise: float) -> None:
    """A robot that drives along a wall brakes for what appears there."""
    walls = with_block(with_block(EMPTY, 4.4, 3.0, 0.8), 3.0, 1.6, 1.2)
    layers, lidar = layered(walls, noise=noise), LidarModel(noise=noise)
    for seed in range(50):
        layers.observe(seen(walls, ROBOT, lidar, seed), ROBOT)
        assert not marks(layers), seed
    layers.observe(seen(with_block(walls, 3.0, 4.5), ROBOT, lidar), ROBOT)
    assert marks(layers)


def test_where_the_robot_itself_is_there_is_no_obstacle() -> None:
    layers = layered()
    ranges = numpy.full(360, 0.12)
    layers.observe(Observation(ROBOT, numpy.linspace(0.0, math.tau, 360), ranges, 3.5), ROBOT)
    assert not marks(layers)


def test_a_rolling_window_forgets_what_is_outside_of_it() -> None:
    block = with_block(EMPTY, 4.2, 3.0)
    rolling, whole = layered(window=3.0), layered()
    for layers in (rolling, whole):
        layers.observe(seen(block, ROBOT), ROBOT)
        assert marks(layers)
    away = Pose(1.0, 1.0, 0.0)
    for layers in (rolling, whole):
        layers.observe(Observation(away, numpy.zeros(1), numpy.array([math.nan]), 3.5), away)
    assert not marks(rolling)
    assert marks(whole)
    assert (rolling.costmap.costs == 0).all()
    window = rolling.window(away)
    assert (window.bottom, window.left) == (0, 0)
    assert (window.top, window.right) == (51, 51)


def test_clearing_as_nav2s_services_do() -> None:
    """The static map stays; a square is as wide as its reset distance."""
    walls = with_block(EMPTY, 1.0, 1.0)
    blocks = with_block(with_block(walls, 4.5, 3.0), 3.0, 4.0)
    right, above = Pose(4.5, 3.0, 0.0), Pose(3.0, 4.0, 0.0)

    def known() -> LayeredCostmap:
        layers = layered(walls)
        layers.observe(seen(blocks, ROBOT), ROBOT)
        assert layers.costmap.in_collision(right)
        assert layers.costmap.in_collision(above)
        return layers

    layers = known()
    layers.clear()
    assert not marks(layers)
    assert layers.costmap.costs.tolist() == Costmap(walls, INFLATION).costs.tolist()
    layers = known()
    layers.clear_square(Pose(3.0, 4.0, 0.0), 0.6)
    assert layers.costmap.in_collision(right)
    assert not layers.costmap.in_collision(above)
    layers = known()
    layers.clear_except_square(Pose(3.0, 4.0, 0.0), 0.6)
    assert not layers.costmap.in_collision(right)
    assert layers.costmap.in_collision(above)


def test_a_local_costmap_is_never_without_what_was_seen_last() -> None:
    """A robot that drives on it must not be blind until the next scan."""
    layers = layered(window=3.0)
    layers.observe(seen(with_block(EMPTY, 4.0, 3.0), ROBOT), ROBOT)
    known = marks(layers)
    assert known
    layers.clear()
    assert marks(layers) == known
    other = layered(with_block(EMPTY, 1.0, 1.0), window=3.0)
    other.continue_from(layers)
    assert marks(other) == known


@pytest.mark.parametrize('window', [3.0, math.inf])
def test_on_another_map_with_the_same_grid_nothing_that_was_seen_is_forgotten(window: float) -> None:
    """Such as that of a no-go zone that has moved: else plans lead through what was seen before, again."""
    layers = layered(window=window)
    layers.observe(seen(with_block(EMPTY, 4.0, 3.0), ROBOT), ROBOT)
    behind = Pose(3.2, 4.0, 0.0)
    layers.observe(Observation(behind, numpy.zeros(1), numpy.array([math.nan]), 3.5), behind)
    known = marks(layers)
    assert known
    walls = with_block(EMPTY, 1.0, 1.0)
    for grid, expected in ((walls, known), (replace(walls, origin=Pose(0.1, 0.0, 0.0)), set())):
        other = layered(grid, window=window)
        other.continue_from(layers)
        assert marks(other) == expected
        assert numpy.array_equal(other.costmap.costs, Costmap(grid, INFLATION, other.costmap.obstacles).costs)


@settings(deadline=None, max_examples=20)
@given(st.data(), worlds(least=10, size=60))
def test_what_is_computed_anew_in_part_is_what_is_computed_as_a_whole(data: st.DataObject, world: OccupancyMap) -> None:
    layers = LayeredCostmap(Costmap(world, INFLATION), window=data.draw(st.sampled_from([1.0, 3.0, math.inf])))
    for _ in range(5):
        place = data.draw(st.tuples(st.floats(0.0, world.height), st.floats(0.0, world.width)))
        robot = Pose(*world.point(*place), data.draw(st.floats(-3.0, 3.0)))
        ranges = data.draw(st.lists(st.floats(0.0, 4.0) | st.just(math.inf), min_size=30, max_size=30))
        layers.observe(Observation(robot, numpy.linspace(0.0, 6.0, 30), numpy.array(ranges), 3.5), robot)
        whole = Costmap(world, INFLATION, layers.costmap.obstacles)
        assert layers.costmap.costs.tolist() == whole.costs.tolist()


@settings(deadline=None, max_examples=30)
@given(st.data(), worlds())
def test_compiled_or_not_the_same_cells_are_marked(data: st.DataObject, world: OccupancyMap) -> None:
    number = st.floats(-10.0, 70.0)
    row, column = data.draw(number), data.draw(number)
    angles = numpy.array(data.draw(st.lists(st.floats(-7.0, 7.0), max_size=30)))
    directions = numpy.stack([numpy.sin(angles), numpy.cos(angles)], axis=1)
    cleared, struck = (
        numpy.array(data.draw(st.lists(st.floats(low, 50.0), min_size=len(angles), max_size=len(angles))))
        for low in (0.0, -1.0)
    )
    before = numpy.random.default_rng(1).random(world.obstacles.shape) < 0.5
    results = []
    for trace in (kernels.trace, kernels.trace.interpreted, array_forms.trace):
        cells = before.copy()
        trace(cells, world.obstacles, row, column, directions, cleared, struck, data.draw(st.just(1.5)))
        results.append(cells.tolist())
    assert results[0] == results[1] == results[2]


def test_a_car_whose_lidar_is_in_front_sees_what_is_behind_it_and_what_is_ahead() -> None:
    car, lidar, robot = MODELS['car'], LidarModel(range_max=60.0, noise=0.0), Pose(10.0, 10.0, 0.0)
    assert car.lidar is not None
    inflation, world = Inflation.of(car.footprint), drawn(*['.' * 400] * 400)
    layers = LayeredCostmap(Costmap(world, inflation), window=local_size(inflation))
    around = with_block(with_block(world, robot.x - 0.9 - 1.5, robot.y), robot.x + 3.4 + 2.0, robot.y)
    layers.observe(seen(around, compose(robot, car.lidar.pose), lidar), robot)
    for there in (drive(robot, -1.0, 0.0, 1.5), drive(robot, 1.0, 0.0, 2.0)):
        assert layers.costmap.in_collision(there)
        assert layers.costmap.gap_seen(there, 1.0) < 0.0
