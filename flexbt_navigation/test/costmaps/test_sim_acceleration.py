# SPDX-License-Identifier: BSD-3-Clause
"""The loops over cells, compiled and interpreted, against the same functions of whole-array operations."""

from __future__ import annotations

import math
import subprocess
import sys
import threading
from collections.abc import Callable
from itertools import pairwise
from typing import Any

import array_forms
import numpy
import pytest
import scipy
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from interpreted import interpret
from numpy.typing import NDArray

from flexbt_navigation.costmaps import kernels
from flexbt_navigation.costmaps.costmap import INSCRIBED, LETHAL, Costmap, Inflation
from flexbt_navigation.costmaps.kernels import neighbours
from flexbt_navigation.planner.planners import WEIGHTS, GridPlanner, PlanningStopped, StopFlag
from flexbt_sim.world import OccupancyMap, Pose
from flexbt_sim.world.plane import loops as sim_loops
from flexbt_sim.world.plane.loops import Loop, nearest
from flexbt_testing.worlds import worlds

INFLATION = Inflation(robot_radius=0.1, radius=0.5)
both = settings(deadline=None, max_examples=60)


@pytest.fixture(autouse=True)
def compiled() -> None:
    if kernels.search.compiled is None:
        pytest.skip('nothing is compiled: FLEXBT_ACCELERATION=0, or no numba')


@both
@given(st.data(), worlds(), st.integers(1, 60))
def test_gaps(data: st.DataObject, world: OccupancyMap, reach: int) -> None:
    bottom, top = sorted(data.draw(st.lists(st.integers(0, world.height), min_size=2, max_size=2, unique=True)))
    left, right = sorted(data.draw(st.lists(st.integers(0, world.width), min_size=2, max_size=2, unique=True)))
    box = (bottom, top, left, right, reach)
    compiled = kernels.squared_gaps(world.obstacles, *box)
    for squared_gaps in (kernels.squared_gaps.interpreted, kernels.squared_gaps_at_once):
        assert compiled.tolist() == squared_gaps(world.obstacles, *box).tolist()
    whole = kernels.squared_gaps(world.obstacles, 0, world.height, 0, world.width, reach)
    assert compiled.tolist() == whole[bottom:top, left:right].tolist()


@both
@given(st.data(), worlds(), st.booleans(), st.floats(0.5, 20.0))
def test_the_nearest_obstacle(data: st.DataObject, world: OccupancyMap, only_new: bool, reach: float) -> None:
    known = numpy.random.default_rng(1).random(world.obstacles.shape) < 0.5
    row, column = data.draw(st.floats(-3.0, world.height + 3.0)), data.draw(st.floats(-3.0, world.width + 3.0))
    compiled = nearest(world.obstacles, known, only_new, row, column, reach)
    for other in (nearest.interpreted, array_forms.nearest):
        assert compiled == other(world.obstacles, known, only_new, row, column, reach)


def way_cost(costs: NDArray[numpy.uint8], directions: NDArray[numpy.int8], start: int, goal: int) -> float:
    """Return what the way to the goal costs; infinite without one."""
    if start != goal and directions[goal] < 0:
        return math.inf
    total, cell, flat = 0.0, goal, costs.ravel()
    while cell != start:
        before = cell - neighbours(costs.shape[1])[directions[cell]]
        length = math.sqrt(2.0) if directions[cell] >= 4 else 1.0
        total += length * (WEIGHTS[flat[cell]] + WEIGHTS[flat[before]]) / 2.0
        cell = before
    return total


def least_cost(costs: NDArray[numpy.uint8], start: int, goal: int) -> float:
    """By Dijkstra's algorithm of scipy."""
    weights, numbers = WEIGHTS[costs], numpy.arange(costs.size).reshape(costs.shape)
    free = numpy.isfinite(weights)
    steps: list[Any] = []
    for up, right in ((0, 1), (1, 0), (1, 1), (1, -1)):
        height, width = costs.shape
        a = slice(0, height - up), slice(max(0, -right), width - max(0, right))
        b = slice(up, height), slice(max(0, right), width + min(0, right))
        there = free[a] & free[b] & free[a[0], b[1]] & free[b[0], a[1]]
        steps.append(
            ((math.hypot(up, right) * (weights[a] + weights[b]) / 2.0)[there], numbers[a][there], numbers[b][there])
        )
    lengths, sources, targets = map(numpy.concatenate, zip(*steps, strict=True))
    graph = scipy.sparse.csr_array((lengths, (sources, targets)), shape=(costs.size, costs.size))
    return float(scipy.sparse.csgraph.dijkstra(graph, directed=False, indices=start)[goal])


@both
@given(st.data(), worlds(least=1, size=60, blocks=20))
def test_the_cheapest_way(data: st.DataObject, world: OccupancyMap) -> None:
    costs = numpy.pad(Costmap(world, INFLATION).costs, 1, constant_values=LETHAL)
    free = numpy.flatnonzero(costs.ravel() < INSCRIBED).tolist()
    assume(free)
    start, goal = data.draw(st.sampled_from(free)), data.draw(st.sampled_from(free))
    spent = [
        way_cost(costs, search(costs, WEIGHTS, start, goal, StopFlag().cell)[0], start, goal)
        for search in (kernels.search, kernels.search.interpreted, array_forms.search)
    ]
    assert spent == pytest.approx([least_cost(costs, start, goal)] * 3, rel=1e-5)


@both
@given(st.data(), worlds(), st.floats(0.0, 9.0))
def test_lines(data: st.DataObject, world: OccupancyMap, radius: float) -> None:
    costmap = Costmap(world, INFLATION)
    place = st.tuples(st.floats(0.0, world.height), st.floats(0.0, world.width))
    start, end = data.draw(place), data.draw(place)
    squares = kernels.squared_gaps(world.obstacles, 0, world.height, 0, world.width, 9)
    clear, mean = kernels.is_clear, kernels.mean_cost
    assert (
        len(
            {
                bool(is_clear(world.obstacles, squares, start, end, radius))
                for is_clear in (clear, clear.interpreted, array_forms.is_clear)
            }
        )
        == 1
    )
    means = [float(one(costmap.costs, start, end)) for one in (mean, mean.interpreted, array_forms.mean_cost)]
    assert means == pytest.approx([means[0]] * 3, rel=1e-9)


def test_without_the_compiler_there_are_the_same_plans(monkeypatch: pytest.MonkeyPatch) -> None:
    cells = numpy.zeros((60, 90), numpy.int8)
    cells[20:24, :60] = cells[40:44, 30:] = 100
    world = OccupancyMap(cells, 0.05, Pose(0.0, 0.0, 0.0))

    def length() -> float:
        path = GridPlanner(Costmap(world, Inflation())).plan(Pose(0.4, 0.4, 0.0), Pose(4.2, 2.6, 0.0))
        return sum(a.distance(b) for a, b in pairwise(path))

    accelerated = length()
    monkeypatch.setenv('FLEXBT_ACCELERATION', '0')
    assert Loop(kernels.search.interpreted).compiled is None
    for module in (kernels, sim_loops):
        interpret(monkeypatch, module)
    assert length() == pytest.approx(accelerated, rel=0.02)


@pytest.mark.parametrize('search', [kernels.search, kernels.search.interpreted], ids=['compiled', 'interpreted'])
def test_a_search_ends_when_it_is_stopped(search: Callable[..., Any]) -> None:
    costs = numpy.zeros((402, 402), numpy.uint8)
    costs[0] = costs[-1] = costs[:, 0] = costs[:, -1] = LETHAL
    stop: Any = StopFlag()
    stop.set()
    reached = (search(costs, WEIGHTS, 403, 401 * 402 - 2, stop.cell)[0] >= 0).sum()
    assert 0 < reached < 20_000
    with pytest.raises(PlanningStopped):
        GridPlanner(Costmap(OccupancyMap(costs.astype(numpy.int8), 0.05, Pose(0.0, 0.0, 0.0)), INFLATION)).plan(
            Pose(1.0, 1.0, 0.0), Pose(9.0, 9.0, 0.0), stop
        )


@pytest.mark.dds('a thread computes while another one stops it')
@pytest.mark.parametrize('search', [kernels.search, kernels.search.interpreted], ids=['compiled', 'interpreted'])
def test_a_search_leaves_the_interpreter_to_others(search: Callable[..., Any]) -> None:
    """Who holds it cannot be stopped: this thread would not run before the search is complete.

    A search that holds it is what kept robots from their goals on large maps: nothing drove them meanwhile.
    """
    size = 2000
    costs = numpy.full((size, size), 100, numpy.uint8)  # where A* has to look everywhere
    costs[0] = costs[-1] = costs[:, 0] = costs[:, -1] = LETHAL

    def stopped() -> bool:
        begins, stop, reached = threading.Event(), StopFlag(), []

        def work() -> None:
            begins.set()
            reached.append(search(costs, WEIGHTS, size + 1, size * (size - 1) - 2, stop.cell)[0][-size - 2])

        thread = threading.Thread(target=work)
        thread.start()
        begins.wait()
        stop.set()
        thread.join()
        return bool(reached[0] < 0)

    assert any(stopped() for _ in range(20))


DRIVE = """
import gc, numpy
from numba.core.dispatcher import Dispatcher
from flexbt_navigation.costmaps.costmap import Costmap, Inflation
from flexbt_navigation.navigator import Navigator
from flexbt_navigation.preparation import prepare_navigation
from flexbt_sim.world import Circle, ObstacleModel, OccupancyMap, Pose, RobotModel, World, box
from flexbt_sim.world.world import prepare_world

def loaded():
    functions = [one for one in gc.get_objects() if isinstance(one, Dispatcher)]
    return {(one.__name__, signature) for one in functions for signature in one.signatures}

prepare_world()
prepare_navigation()
before = loaded()
cells = numpy.zeros((120, 120), numpy.int8)
cells[:2] = cells[-2:] = cells[:, :2] = cells[:, -2:] = 100
for shape in (Circle(0.2), box(0.4, 0.3)):
    world = World(OccupancyMap(cells, 0.05, Pose(0.0, 0.0, 0.0)))
    robot = world.add('robot', RobotModel(footprint=shape), Pose(1.0, 1.0, 0.0))
    world.add('crate', ObstacleModel(Pose(3.0, 3.0, 0.3), box(0.5, 0.4)))
    navigator = Navigator(world, 'robot', Costmap(world.map, Inflation()))
    navigator.navigate(Pose(5.0, 5.0, 0.0))
    for _ in range(2000):
        robot.command(0.2, 0.0, world.time)
        world.step()
    assert robot.in_contact
assert len({name for name, _ in before}) >= 9, before
assert loaded() == before, loaded() - before
"""


def test_all_that_is_compiled_is_there_before_a_robot_drives() -> None:
    """A compilation takes seconds, in which a node does nothing else."""
    done = subprocess.run([sys.executable, '-c', DRIVE], capture_output=True, text=True, timeout=300, check=False)
    assert done.returncode == 0, done.stderr
