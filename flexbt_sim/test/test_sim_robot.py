# SPDX-License-Identifier: BSD-3-Clause
"""The robot on random maps under random commands: walls, limits, watchdog, steps of any size."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import NamedTuple

import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from sim_maps import drawn, places, room, worlds

from flexbt_sim.world import COLLISION_CHECK_DISTANCE, TICK, OccupancyMap, Pose, RobotLimits
from flexbt_sim.world import MapRobot as Robot

LIMITS = RobotLimits()
ROUNDING = 1e-6
OPEN = drawn('.' * 400)
START = Pose(10.0, 0.0, 0.0)
BOX = drawn('#' * 62, *['#' + '.' * 60 + '#'] * 60, '#' * 62)
"""3 m by 3 m within walls; the lower left inner corner is at (0.05, 0.05)."""

robots = st.builds(
    RobotLimits,
    linear_speed=st.sampled_from([0.26, 1.0, 10.0]),
    angular_speed=st.floats(0.1, 6.0),
    linear_acceleration=st.sampled_from([0.5, 2.5, 100.0]),
    angular_acceleration=st.floats(0.5, 50.0),
    radius=st.sampled_from([0.05, 0.22, 0.5]),
)
exhaustive = settings(deadline=None, max_examples=80)


class Drive(NamedTuple):
    """A step of so many s, and the command before it, if there is one."""

    duration: float
    command: tuple[float, float] | None


def drives(durations: st.SearchStrategy[float], limit: int = 25) -> st.SearchStrategy[list[Drive]]:
    speeds = st.tuples(st.floats(-12.0, 12.0), st.floats(-7.0, 7.0))
    return st.lists(st.builds(Drive, durations, st.none() | speeds), min_size=1, max_size=limit)


def enclosed(data: st.DataObject, limits: RobotLimits) -> tuple[OccupancyMap, Robot]:
    """A robot somewhere on a map where it fits."""
    world = data.draw(worlds())
    start = data.draw(places(world))
    assume(room(world, start.x, start.y) >= limits.radius)
    return world, Robot(world, start, limits)


@exhaustive
@given(st.data(), robots, drives(st.floats(1e-4, 0.1) | st.floats(0.1, 5.0)))
def test_it_never_overlaps_an_obstacle_and_keeps_its_limits(
    data: st.DataObject, limits: RobotLimits, run: list[Drive]
) -> None:
    world, robot = enclosed(data, limits)
    now = 0.0
    for duration, command in run:
        if command:
            robot.command(*command, now)
        now += duration
        before, linear, angular = robot.pose, robot.linear, robot.angular
        robot.step(now, duration)
        assert room(world, robot.pose.x, robot.pose.y) >= limits.radius - ROUNDING
        assert abs(robot.linear) <= limits.linear_speed
        assert abs(robot.angular) <= limits.angular_speed
        assert before.distance(robot.pose) <= limits.linear_speed * duration + ROUNDING
        assert abs(robot.angular - angular) <= limits.angular_acceleration * duration + ROUNDING
        stopped_by_a_wall = duration > TICK or robot.in_contact
        assert stopped_by_a_wall or abs(robot.linear - linear) <= limits.linear_acceleration * duration + ROUNDING


@exhaustive
@given(st.data(), drives(st.integers(1, 60).map(lambda ticks: ticks * TICK), limit=8))
def test_what_happens_does_not_depend_on_the_size_of_the_steps(data: st.DataObject, run: list[Drive]) -> None:
    """No wall is jumped over, and the watchdog does not wait for the next step."""
    limits = replace(LIMITS, watchdog=0.505, linear_speed=10.0, linear_acceleration=10.0)  # on no border between ticks
    world, coarse = enclosed(data, limits)
    fine = Robot(world, coarse.pose, limits)
    ticks = 0
    for duration, command in run:
        if command:
            coarse.command(*command, ticks * TICK)
            fine.command(*command, ticks * TICK)
        for _ in range(round(duration / TICK)):
            ticks += 1
            fine.step(ticks * TICK, TICK)
        coarse.step(ticks * TICK, duration)
        assert tuple(coarse.pose) == pytest.approx(tuple(fine.pose), abs=1e-5)
        assert (coarse.linear, coarse.angular) == pytest.approx((fine.linear, fine.angular))


def test_it_reverses_within_a_step() -> None:
    robot = Robot(OPEN, START, LIMITS)
    robot.command(0.0, 1.0, 0.0)
    robot.step(TICK, TICK)
    robot.command(0.0, -1.0, TICK)
    robot.step(3 * TICK, 2 * TICK)  # its speed is 0 on the way
    assert robot.angular == pytest.approx(-LIMITS.angular_acceleration * TICK)


@exhaustive
@given(st.data(), drives(st.floats(1e-3, 0.5)))
def test_the_same_commands_lead_to_the_same_place(data: st.DataObject, run: list[Drive]) -> None:
    world, one = enclosed(data, LIMITS)
    other = Robot(world, one.pose, LIMITS)
    for robot in (one, other):
        now = 0.0
        for duration, command in run:
            if command:
                robot.command(*command, now)
            now += duration
            robot.step(now, duration)
    assert (one.pose, one.linear, one.angular) == (other.pose, other.linear, other.angular)


@settings(deadline=None)
@given(st.floats(-0.26, 0.26), st.floats(-1.82, 1.82), st.floats(1e-3, 3.0))
def test_it_drives_on_until_the_watchdog_and_is_at_rest_after_braking(
    linear: float, angular: float, duration: float
) -> None:
    robot = Robot(OPEN, START, LIMITS)
    now = 0.0
    for _ in range(100):
        now += TICK
        robot.command(linear, angular, now)
        robot.step(now, TICK)
    last = now
    robot.step(now := last + LIMITS.watchdog - TICK, LIMITS.watchdog - TICK)
    assert (robot.linear, robot.angular) == pytest.approx((linear, angular))
    braking = max(abs(linear) / LIMITS.linear_acceleration, abs(angular) / LIMITS.angular_acceleration)
    while now < last + LIMITS.watchdog + braking + TICK:
        now += duration
        robot.step(now, duration)
    assert (robot.linear, robot.angular) == (0.0, 0.0)
    rest = robot.pose
    robot.step(now + 1e9, 1e9)
    assert robot.pose == rest


def test_it_stands_still_before_the_first_command_and_after_it_was_placed() -> None:
    robot = Robot(OPEN, START, LIMITS)
    robot.step(10.0, 10.0)
    assert robot.pose == START
    robot.command(0.26, 1.0, 10.0)
    robot.step(10.2, 0.2)
    assert robot.linear > 0.0
    there = Pose(3.0, 0.0, 1.0)
    robot.place(there)
    assert (robot.linear, robot.angular, robot.commanded_at) == (0.0, 0.0, None)
    robot.step(10.3, 0.1)
    assert robot.pose == there


NUMBERS = st.floats(-1.0, 1.0)
NO_NUMBERS = st.sampled_from([math.nan, math.inf, -math.inf])


@given(st.tuples(NUMBERS, NO_NUMBERS) | st.tuples(NO_NUMBERS, NUMBERS) | st.tuples(NO_NUMBERS, NO_NUMBERS))
def test_a_command_that_is_not_finite_means_to_stop(command: tuple[float, float]) -> None:
    robot = Robot(OPEN, START, LIMITS)
    robot.command(0.26, 1.0, 0.0)
    robot.step(0.4, 0.4)
    robot.command(*command, 0.4)
    robot.step(0.9, 0.5)  # the watchdog would let it drive on
    assert (robot.linear, robot.angular) == (0.0, 0.0)
    assert all(map(math.isfinite, robot.pose))
    assert robot.pose.x < START.x + 0.26 * 0.5


@settings(deadline=None, max_examples=15)
@given(st.floats(-math.pi, math.pi), st.sampled_from([0.26, 10.0]), st.sampled_from([0.01, 0.3, 9.0]))
def test_a_wall_stops_it_where_it_touches(heading: float, speed: float, duration: float) -> None:
    robot = Robot(BOX, Pose(1.55, 1.55, heading), replace(LIMITS, linear_speed=speed, watchdog=1e9))
    robot.command(speed, 0.0, 0.0)
    now = 0.0
    while now < 9.0:
        now += duration
        robot.step(now, duration)
    assert robot.in_contact
    assert robot.linear == 0.0
    assert LIMITS.radius - ROUNDING <= room(BOX, robot.pose.x, robot.pose.y) <= LIMITS.radius + COLLISION_CHECK_DISTANCE
    assert robot.pose.bearing(1.55, 1.55) == pytest.approx(math.copysign(math.pi, robot.pose.bearing(1.55, 1.55)))


def test_in_contact_it_can_turn_and_leave() -> None:
    robot = Robot(BOX, Pose(0.5, 1.5, math.pi), LIMITS)
    for number in range(200):
        robot.command(0.26, 0.0, number * TICK)
        robot.step((number + 1) * TICK, TICK)
    touching = robot.pose
    robot.command(0.0, -1.0, 2.0)
    robot.step(2.4, 0.4)
    contacts = [robot.in_contact]
    assert robot.pose[:2] == touching[:2]
    assert robot.pose.yaw < math.pi - 0.2
    robot.place(touching)
    robot.command(-0.26, 0.0, 2.4)
    robot.step(2.8, 0.4)
    contacts.append(robot.in_contact)
    assert contacts == [True, False]
    assert robot.pose.x > touching.x + 0.08


def test_a_robot_that_overlaps_a_wall_can_only_leave_it() -> None:
    for speed, distance in ((0.26, 0.0), (-0.26, 0.1)):
        robot = Robot(BOX, Pose(0.15, 1.5, math.pi), LIMITS)
        robot.command(speed, 0.0, 0.0)
        robot.step(0.5, 0.5)
        assert robot.in_contact == (speed > 0.0)
        assert robot.pose.x - 0.15 == pytest.approx(distance, abs=0.02)


def test_beside_the_map_there_is_nothing_but_the_map() -> None:
    """It may leave a map that is open, and does not come in through its outer walls."""
    robot = Robot(BOX, Pose(-2.0, 1.5, math.pi), replace(LIMITS, linear_speed=1.0, watchdog=10.0))
    robot.command(1.0, 0.0, 0.0)
    robot.step(2.0, 2.0)
    assert robot.pose.x == pytest.approx(-3.8, abs=0.02)
    robot.command(-1.0, 0.0, 2.0)
    robot.step(9.0, 7.0)
    assert robot.in_contact
    assert robot.pose.yaw == math.pi
    assert robot.pose.x == pytest.approx(-LIMITS.radius, abs=COLLISION_CHECK_DISTANCE)
