# SPDX-License-Identifier: BSD-3-Clause
"""The robot on random maps under random commands: limits, walls, watchdog."""

from __future__ import annotations

import math
import random
from itertools import pairwise

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from sim_maps import cluttered, drawn, free_pose

from flexbt_sim.geometry import Pose
from flexbt_sim.robot import Robot, RobotLimits

STEP = 0.02
LIMITS = RobotLimits()
ROUNDING = 1e-9


def random_run(seed: int, steps: int = 600) -> list[tuple[Pose, float, float]]:
    """Pose and speeds after each step."""
    chance = random.Random(seed)
    world = cluttered(seed)
    start = free_pose(world, chance, LIMITS.radius + 0.1)
    if start is None:
        return []
    robot = Robot(world, start, LIMITS)
    states = [(robot.pose, 0.0, 0.0)]
    for number in range(steps):
        if chance.random() < 0.1:
            robot.command(chance.uniform(-1, 1), chance.uniform(-4, 4), number * STEP)
        robot.step(number * STEP, STEP)
        states.append((robot.pose, robot.linear, robot.angular))
    return states


@settings(max_examples=40)
@given(st.integers(0, 10**6))
def test_never_in_a_wall_and_within_the_limits(seed: int) -> None:
    world = cluttered(seed)
    states = random_run(seed)
    for pose, linear, angular in states:
        assert world.clearance(pose.x, pose.y) >= LIMITS.radius - ROUNDING
        assert abs(linear) <= LIMITS.linear_speed
        assert abs(angular) <= LIMITS.angular_speed
    for (before, linear, angular), (after, faster, turning) in pairwise(states):
        assert before.distance(after) <= LIMITS.linear_speed * STEP + ROUNDING
        assert abs(turning - angular) <= LIMITS.angular_acceleration * STEP + ROUNDING
        assert faster == 0.0 or abs(faster - linear) <= LIMITS.linear_acceleration * STEP + ROUNDING


def test_the_same_seed_gives_the_same_run() -> None:
    assert random_run(7) == random_run(7)
    assert random_run(7) != random_run(8)


@given(st.floats(-0.26, 0.26), st.floats(-1.82, 1.82))
def test_at_rest_after_the_watchdog_and_braking(linear: float, angular: float) -> None:
    robot = Robot(drawn('.' * 400), Pose(10.0, 0.0, 0.0), LIMITS)
    now = 0.0
    while now < 2.0:
        if now < 1.0:
            robot.command(linear, angular, now)
            last = now
        robot.step(now, STEP)
        now += STEP
        braking = max(abs(linear) / LIMITS.linear_acceleration, abs(angular) / LIMITS.angular_acceleration)
        if now > last + LIMITS.watchdog + braking + 2 * STEP:
            assert (robot.linear, robot.angular) == (0.0, 0.0)


@pytest.mark.parametrize('value', [math.nan, math.inf, -math.inf])
def test_commands_that_are_no_numbers_move_nothing_beyond_the_limits(value: float) -> None:
    robot = Robot(drawn('.' * 400), Pose(10.0, 0.0, 0.0), LIMITS)
    for number in range(100):
        robot.command(value, value, number * STEP)
        robot.step(number * STEP, STEP)
        assert all(math.isfinite(part) for part in robot.pose)
        assert abs(robot.linear) <= LIMITS.linear_speed
    assert math.isfinite(value * 0.0) or not math.isnan(value) or robot.pose == (10.0, 0.0, 0.0)


def test_a_wall_stops_it_at_contact_and_it_can_leave() -> None:
    world = drawn(*['#' + '.' * 58 + '#'] * 40)
    robot = Robot(world, Pose(1.0, 1.0, 0.0), LIMITS)
    for number in range(1500):
        robot.command(1.0, 0.0, number * STEP)
        robot.step(number * STEP, STEP)
    assert robot.in_contact
    assert robot.linear == 0.0
    assert world.clearance(robot.pose.x, robot.pose.y) == pytest.approx(LIMITS.radius, abs=world.resolution)
    touching = robot.pose.x
    for number in range(1500, 1600):
        robot.command(-1.0, 0.0, number * STEP)
        robot.step(number * STEP, STEP)
    assert robot.pose.x < touching - 0.3
