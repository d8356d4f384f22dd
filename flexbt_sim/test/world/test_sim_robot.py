# SPDX-License-Identifier: BSD-3-Clause
"""A robot alone on random maps under random commands: walls, limits, watchdog, steps of any size."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import NamedTuple

import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from flexbt_sim.errors import SimulationError
from flexbt_sim.world import Circle, DriveModel, OccupancyMap, Pose, Robot, RobotModel, World
from flexbt_testing.worlds import drawn, places, room, worlds

MODEL = RobotModel(lidar=None)
DRIVE = MODEL.drive
RADIUS = MODEL.footprint.radius
ROUNDING = 1e-6
CONTACT = 0.002
"""Not farther than this, m, from what has stopped it."""

OPEN = drawn('.' * 400)
START = Pose(10.0, 0.02, 0.0)
BOX = drawn('#' * 62, *['#' + '.' * 60 + '#'] * 60, '#' * 62)
"""3 m by 3 m within walls; the lower left inner corner is at (0.05, 0.05)."""

models = st.builds(
    RobotModel,
    footprint=st.sampled_from([Circle(0.05), Circle(0.22), Circle(0.5)]),
    drive=st.builds(
        DriveModel,
        linear_speed=st.sampled_from([0.26, 1.0, 10.0]),
        angular_speed=st.floats(0.1, 6.0),
        linear_acceleration=st.sampled_from([0.5, 2.5, 100.0]),
        angular_acceleration=st.floats(0.5, 50.0),
    ),
    lidar=st.none(),
)
exhaustive = settings(deadline=None, max_examples=80)


class Drive(NamedTuple):
    """A step of so many s, and the command before it, if there is one."""

    duration: float
    command: tuple[float, float] | None


commands = st.tuples(st.floats(-12.0, 12.0), st.floats(-7.0, 7.0))


def drives(durations: st.SearchStrategy[float]) -> st.SearchStrategy[list[Drive]]:
    return st.lists(st.builds(Drive, durations, st.none() | commands), min_size=1, max_size=25)


def alone(grid: OccupancyMap, start: Pose, drive: DriveModel = DRIVE, step: float = 0.01) -> tuple[World, Robot]:
    """Return a robot on a map."""
    world = World(grid, step=step)
    return world, world.add('robot', replace(MODEL, drive=drive), start)


def enclosed(data: st.DataObject, model: RobotModel) -> tuple[World, Robot]:
    """Return a robot somewhere on a map where it fits."""
    grid = data.draw(worlds())
    start = data.draw(places(grid))
    assume(grid.contains(*grid.cell(start.x, start.y)))
    assume(room(grid, start.x, start.y) >= model.footprint.radius + ROUNDING)
    world = World(grid)
    return world, world.add('robot', model, start)


@exhaustive
@given(st.data(), models, drives(st.floats(1e-4, 0.1) | st.floats(0.1, 5.0)))
def test_it_never_overlaps_an_obstacle_and_keeps_its_limits(
    data: st.DataObject, model: RobotModel, run: list[Drive]
) -> None:
    world, robot = enclosed(data, model)
    assert world.map is not None
    limits = model.drive
    for duration, command in run:
        if command:
            robot.command(*command, world.time)
        before, linear, angular = robot.pose, robot.linear, robot.angular
        world.step(duration)
        assert room(world.map, robot.pose.x, robot.pose.y) >= robot.radius - ROUNDING
        assert abs(robot.linear) <= limits.linear_speed
        assert abs(robot.angular) <= limits.angular_speed
        assert before.distance(robot.pose) <= limits.linear_speed * duration + ROUNDING
        assert abs(robot.angular - angular) <= limits.angular_acceleration * duration + ROUNDING
        stopped_by_a_wall = duration > world.step_size or robot.in_contact
        assert stopped_by_a_wall or abs(robot.linear - linear) <= limits.linear_acceleration * duration + ROUNDING


@settings(deadline=None, max_examples=15)
@given(st.data(), st.lists(st.tuples(st.integers(1, 60), st.none() | commands), min_size=1, max_size=8))
def test_what_happens_does_not_depend_on_how_the_time_is_passed(
    data: st.DataObject, run: list[tuple[int, tuple[float, float] | None]]
) -> None:
    """In one call or a step at a time; the watchdog does not wait for the next call."""
    quick = replace(MODEL, drive=DriveModel(linear_speed=10.0, linear_acceleration=10.0))
    at_once, one = enclosed(data, quick)
    by_steps = World(at_once.map)
    other = by_steps.add('robot', quick, one.pose)
    for steps, command in run:
        if command:
            one.command(*command, at_once.time)
            other.command(*command, by_steps.time)
        at_once.step(steps * at_once.step_size)
        for _ in range(steps):
            by_steps.step()
        assert at_once.snapshot() == by_steps.snapshot()


def test_it_reverses_within_a_step() -> None:
    world, robot = alone(OPEN, START)
    robot.command(0.0, 1.0, world.time)
    world.step()
    robot.command(0.0, -1.0, world.time)
    world.step(2.0 * world.step_size)  # its speed is 0 on the way
    assert robot.angular == pytest.approx(-DRIVE.angular_acceleration * world.step_size)


@settings(deadline=None)
@given(st.floats(-0.26, 0.26), st.floats(-1.82, 1.82), st.floats(1e-3, 3.0))
def test_it_drives_on_until_the_watchdog_and_is_at_rest_after_braking(
    linear: float, angular: float, duration: float
) -> None:
    world, robot = alone(OPEN, START)
    for _ in range(100):
        robot.command(linear, angular, world.time)
        world.step()
    ends = world.time - world.step_size + DRIVE.watchdog
    world.step(ends - world.time)
    assert (robot.linear, robot.angular) == pytest.approx((linear, angular))
    braking = max(abs(linear) / DRIVE.linear_acceleration, abs(angular) / DRIVE.angular_acceleration)
    while world.time < ends + braking + 2.0 * world.step_size:
        world.step(duration)
    assert (robot.linear, robot.angular) == (0.0, 0.0)
    rest = robot.pose
    world.step(10.0)
    assert robot.pose == rest


def test_it_stands_still_before_the_first_command_and_after_it_was_placed() -> None:
    world, robot = alone(OPEN, START)
    world.step(10.0)
    assert robot.pose == START
    robot.command(0.26, 1.0, world.time)
    world.step(0.2)
    assert robot.linear > 0.0
    there = Pose(3.0, 0.02, 1.0)
    world.move('robot', there)
    assert not robot.is_driven(world.time)
    world.step(0.1)
    assert robot.pose == there


NUMBERS = st.floats(-1.0, 1.0)
NO_NUMBERS = st.sampled_from([math.nan, math.inf, -math.inf])


@settings(deadline=None, max_examples=30)
@given(st.tuples(NUMBERS, NO_NUMBERS) | st.tuples(NO_NUMBERS, NUMBERS) | st.tuples(NO_NUMBERS, NO_NUMBERS))
def test_a_command_that_is_not_finite_means_to_stop(command: tuple[float, float]) -> None:
    world, robot = alone(OPEN, START, replace(DRIVE, watchdog=60.0))
    robot.command(0.26, 1.0, world.time)
    world.step(0.4)
    robot.command(*command, world.time)
    world.step(0.5)
    assert (robot.linear, robot.angular) == (0.0, 0.0)
    assert all(map(math.isfinite, robot.pose))
    assert robot.pose.x < START.x + 0.26 * 0.5


@settings(deadline=None, max_examples=15)
@given(st.floats(-math.pi, math.pi), st.sampled_from([0.26, 10.0]), st.sampled_from([0.01, 0.3, 1.0]))
def test_a_wall_stops_it_where_it_touches(heading: float, speed: float, step: float) -> None:
    """However far it would go in a step of the world."""
    world, robot = alone(BOX, Pose(1.55, 1.55, heading), replace(DRIVE, linear_speed=speed, watchdog=60.0), step)
    robot.command(speed, 0.0, world.time)
    world.step(9.0)
    assert robot.in_contact
    assert robot.linear == 0.0
    assert RADIUS - ROUNDING <= room(BOX, robot.pose.x, robot.pose.y) <= RADIUS + CONTACT
    assert abs(robot.pose.bearing(1.55, 1.55)) == pytest.approx(math.pi)


@pytest.mark.parametrize('speed', [0.0, 0.26])
def test_in_contact_it_can_turn_and_leave(speed: float) -> None:
    """It turns even while it is told to go on."""
    world, robot = alone(BOX, Pose(0.5, 1.5, math.pi), replace(DRIVE, watchdog=60.0))
    robot.command(0.26, 0.0, world.time)
    world.step(2.0)
    touching = robot.pose
    robot.command(speed, -1.0, world.time)
    world.step(0.4)
    assert world.state('robot').in_contact
    assert robot.pose[:2] == pytest.approx(touching[:2], abs=CONTACT)
    assert robot.pose.yaw < math.pi - 0.2
    robot.command(-0.26, 0.0, world.time)
    world.step(0.4)
    assert not world.state('robot').in_contact
    assert robot.pose.x > touching.x + 0.08


@pytest.mark.parametrize(('speed', 'distance'), [(0.26, 0.0), (-0.26, 0.1)])
def test_robots_that_overlap_can_only_part(speed: float, distance: float) -> None:
    world, robot = alone(OPEN, START)
    world.move('robot', Pose(5.0, 0.02, 0.0))
    other = world.add('other', MODEL, Pose(START.x + RADIUS, START.y, 0.0))
    before = world.snapshot()
    with pytest.raises(SimulationError, match=r"'other' at .* would overlap 'robot'; remove one of the two"):
        world.reset()
    assert world.snapshot() == before
    robot.place(START)
    world._space.changed()
    assert robot.pose.distance(other.pose) < 2.0 * RADIUS
    robot.command(speed, 0.0, world.time)
    world.step(0.5)
    assert robot.in_contact == (speed > 0.0)
    assert START.x - robot.pose.x == pytest.approx(distance, abs=0.02)


def test_beside_the_map_there_is_nothing_but_the_map() -> None:
    """It may leave a map that is open, and does not come in through its outer walls."""
    grid = drawn(*['#' + '.' * 60] * 30, *['.' * 61] * 30)  # its left side is open up to y = 1.5
    agile = DriveModel(linear_speed=1.0, linear_acceleration=1000.0, angular_acceleration=1000.0, watchdog=60.0)
    world, robot = alone(grid, Pose(0.5, 0.7, math.pi), agile)
    for command, seconds in (((1.0, 0.0), 1.5), ((1.0, -1.0 / 0.75), 0.75 * math.pi), ((1.0, 0.0), 3.0)):
        robot.command(*command, world.time)
        world.step(seconds)
        assert robot.in_contact == (seconds == 3.0)
    # Out to x = -1.0, half a circle, and back.
    assert tuple(robot.pose) == pytest.approx((-RADIUS, 2.2, 0.0), abs=CONTACT)
