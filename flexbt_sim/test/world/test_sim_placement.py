# SPDX-License-Identifier: BSD-3-Clause
"""Where a robot can be put, and what is said about other places."""

from __future__ import annotations

import contextlib
import math
import sys
from collections.abc import Callable
from types import FrameType
from typing import Any

import numpy
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from flexbt_sim.errors import SimulationError
from flexbt_sim.world import Circle, ObstacleModel, OccupancyMap, Polygon, Pose, RobotModel, WalkModel, World, ZoneModel
from flexbt_testing.worlds import drawn, places, room, worlds


@settings(deadline=None)
@given(st.data(), worlds(), st.floats(0.01, 1.0))
def test_a_place_is_accepted_where_the_robot_fits_on_the_map(
    data: st.DataObject, world: OccupancyMap, radius: float
) -> None:
    pose = data.draw(places(world, beside=3.0))
    fits = world.contains(*world.cell(*pose[:2])) and room(world, *pose[:2]) >= radius
    try:
        World(world).add('alpha', RobotModel(footprint=Circle(radius), lidar=None), pose)
    except SimulationError as error:
        assert not fits
        assert f'({pose.x:g}, {pose.y:g}' in str(error)
    else:
        assert fits


@pytest.mark.parametrize(
    ('pose', 'said'),
    [
        (Pose(math.nan, 1.0, 0.0), 'finite'),
        (Pose(1.0, 1.0, math.inf), 'finite'),
        (Pose(5.0, 1.0, 0.0), 'outside of the map of 2 x 1.5 m with its corner at (0, 0)'),
        (Pose(0.15, 1.0, 0.0), "0.10 m from an obstacle, and 'alpha' has a radius of 0.22 m"),
    ],
)
def test_the_reason_is_said(pose: Pose, said: str) -> None:
    world = drawn(*['#' + '.' * 39] * 30)
    with pytest.raises(SimulationError) as raised:
        World(world).add('alpha', RobotModel(), pose)
    assert said in str(raised.value)


@pytest.mark.parametrize(('start', 'is_on_map'), [((19.0, 20.0), True), ((40.0, -12.0), False), ((10.5, 10.1), False)])
def test_a_zone_is_on_the_map_with_its_area_wherever_its_origin_is(start: tuple[float, float], is_on_map: bool) -> None:
    """Its corners may be given in the frame of the map, which may be larger than any body."""
    world = World(OccupancyMap(numpy.zeros((60, 130), numpy.int8), 1.0, Pose(10.0, 10.0, 0.3)))
    x, y = start
    zone = ZoneModel(kind='slow', area=Polygon((start, (x + 2.0, y), (x + 2.0, y - 2.0))))
    with contextlib.nullcontext() if is_on_map else pytest.raises(SimulationError, match='outside of the map'):
        world.add('mud', zone)


near = st.builds(Pose, st.floats(-4.0, 4.0), st.floats(-4.0, 4.0), st.just(0.0))
step_or_change = st.tuples(
    st.sampled_from(['robot', 'walker', 'move', 'remove', 'step', 'step']), st.integers(0, 9), near
)


@settings(deadline=None, max_examples=50)
@given(st.lists(step_or_change, min_size=4))
def test_what_comes_and_goes_while_time_passes_is_refused_where_it_would_overlap(
    calls: list[tuple[str, int, Pose]],
) -> None:
    world = World()
    radii = {'robot': 0.7, 'walker': 0.3}
    for number, (call, index, pose) in enumerate(calls):
        bodies = {**world.robots, **world.obstacles}
        chosen = sorted(bodies)[index % len(bodies)] if bodies else ''
        if call == 'step':
            for robot in world.robots.values():
                robot.command(0.2, 0.3, world.time)
            world.step(0.05 * (index + 1))
        elif call == 'remove' and chosen:
            world.remove(chosen)
        elif call in radii or chosen:
            name = chosen if call == 'move' else f'{call}{number}'
            kind = name.rstrip('0123456789')
            gaps = [
                one.pose.distance(pose) - one.radius - radii[kind]
                for one in bodies.values()
                if one.name != name and 'robot' in (kind, one.name.rstrip('0123456789'))
            ]
            if any(abs(gap) < 1e-6 for gap in gaps):
                continue
            try:
                if call == 'move':
                    world.move(name, pose)
                elif call == 'robot':
                    world.add(name, RobotModel(footprint=Circle(radii[call]), lidar=None), pose)
                else:
                    world.add(name, ObstacleModel(pose, Circle(radii[call]), random_walk=WalkModel(speed=2.0)))
            except SimulationError:
                assert min(gaps) < 0.0
            else:
                assert min(gaps, default=0.0) >= 0.0


def test_who_has_gone_elsewhere_is_met_there() -> None:
    world = World()
    alpha = world.add('alpha', RobotModel(footprint=Circle(0.2), lidar=None), Pose(0.0, 0.0, 0.0))
    world.check_place('alpha', Pose(9.0, 0.0, 0.0))
    for _ in range(200):
        alpha.command(0.2, 0.0, world.time)
        world.step(0.1)
    with pytest.raises(SimulationError, match="would overlap 'alpha'"):
        world.add('beta', RobotModel(footprint=Circle(0.2), lidar=None), alpha.pose)
    world.add('beta', RobotModel(footprint=Circle(0.2), lidar=None), Pose(0.0, 0.0, 0.0))


def test_work_is_in_proportion_to_how_many_come_and_go() -> None:
    def come_and_go(count: int) -> Callable[[], None]:
        world = World()

        def run() -> None:
            for number in range(count):
                at = Pose(3.0 * (number % 20), 3.0 * (number // 20), 0.0)
                world.add(f'robot{number}', RobotModel(footprint=Circle(0.2), lidar=None), at)
                world.add(f'box{number}', ObstacleModel(Pose(at.x + 1.5, at.y, 0.0), Circle(0.2)))
            for number in range(count):
                world.remove(f'box{number}')

        return run

    assert lines_of(come_and_go(100)) < 1.3 * 2 * lines_of(come_and_go(50))


def test_who_comes_to_a_running_world_costs_no_more_among_many() -> None:
    def one_comes(others: int) -> int:
        world = World()
        for number in range(others):
            at = Pose(3.0 * (number % 20), 3.0 * (number // 20), 0.0)
            world.add(f'box{number}', ObstacleModel(at, Circle(0.2)))

        def run() -> None:
            world.add('robot', RobotModel(footprint=Circle(0.2), lidar=None), Pose(1.5, 0.0, 0.0))
            world.move('box0', Pose(0.1, 0.0, 0.0))
            world.check_place('robot', Pose(1.6, 0.0, 0.0))
            world.remove('robot')

        count = 0
        for _ in range(3):
            world.step()
            count += lines_of(run)
        return count

    assert one_comes(200) < 1.1 * one_comes(50)


def test_work_is_in_proportion_to_how_many_have_faults() -> None:
    def faults(count: int) -> Callable[[], None]:
        world = World()
        for number in range(count):
            world.add(f'robot{number}', RobotModel(footprint=Circle(0.2), lidar=None), Pose(number, 0.0, 0.0))

        def run() -> None:
            for number in range(count):
                world.set_fault(f'robot{number}', 'stuck_wheel', after=1.0)
                world.set_fault(f'robot{number}', 'localization_lost')
                world.set_fault(f'robot{number}', 'stuck_wheel', after=2.0)
            world.snapshot()
            for number in range(count):
                world.clear_fault(f'robot{number}')

        return run

    assert lines_of(faults(80)) < 1.3 * 2 * lines_of(faults(40))


def lines_of(run: Callable[[], None]) -> int:
    """Return how many lines of Python are gone through: the same on each computer."""
    count, tracing = 0, sys.gettrace()

    def trace(frame: FrameType, event: str, argument: Any) -> Any:
        nonlocal count
        count += event == 'line'
        return trace

    sys.settrace(trace)
    try:
        run()
    finally:
        sys.settrace(tracing)
    return count
