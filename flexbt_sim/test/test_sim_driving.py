# SPDX-License-Identifier: BSD-3-Clause
"""Motions in closed loop with the robot: where it arrives, what stops it, and that it touches nothing."""

from __future__ import annotations

import math
import random

import numpy
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from sim_maps import cluttered, drawn, free_pose

from flexbt_sim.costmap import Costmap, Inflation
from flexbt_sim.errors import NavigationError
from flexbt_sim.geometry import Pose, wrap
from flexbt_sim.motions import DriveMotion, Motion, SpinMotion
from flexbt_sim.occupancy_map import OccupancyMap
from flexbt_sim.path_follower import FollowerLimits, PathFollower
from flexbt_sim.planner import GridPlanner
from flexbt_sim.robot import Robot, RobotLimits

CONTROL = 0.05
STEP = 0.01
LIMITS = RobotLimits()
INFLATION = Inflation()
FOLLOWER = FollowerLimits()
OPEN = drawn(*['.' * 120] * 120)


def run(world: OccupancyMap, start: Pose, motion: Motion, timeout: float = 300.0) -> tuple[Robot, float]:
    """Let a motion drive the robot from rest until it is complete; the robot, and the time that it took, s."""
    robot = Robot(world, start, LIMITS)
    now = 0.0
    while (velocity := motion.step(robot.pose, now)) is not None:
        assert now < timeout, f'not complete after {timeout} s'
        assert all(math.isfinite(part) for part in velocity)
        robot.command(*velocity, now)
        for _ in range(round(CONTROL / STEP)):
            robot.step(now, STEP)
            now += STEP
            assert not robot.in_contact, f'touched a wall at {robot.pose}'
    return robot, now


def arrives(world: OccupancyMap, start: Pose, goal: Pose) -> None:
    costmap = Costmap(world, INFLATION)
    path = GridPlanner(costmap).plan(start, goal)
    robot, _ = run(world, start, PathFollower(path, costmap, FOLLOWER))
    assert robot.pose.distance(goal) <= FOLLOWER.xy_tolerance + 0.02
    assert abs(wrap(robot.pose.yaw - goal.yaw)) <= FOLLOWER.yaw_tolerance + 0.05


def least_clearance(world: OccupancyMap, start: Pose, goal: Pose) -> float:
    return min(world.clearance(pose.x, pose.y) for pose in GridPlanner(Costmap(world, INFLATION)).plan(start, goal))


@settings(max_examples=12, deadline=None, derandomize=True)
@example(660)
@given(st.integers(0, 10**6))
def test_arrives_on_random_maps_and_touches_nothing(seed: int) -> None:
    chance = random.Random(seed)
    world = cluttered(seed, blocks=8)
    room = INFLATION.robot_radius + 0.15
    start, goal = free_pose(world, chance, room), free_pose(world, chance, room)
    if start is None or goal is None:
        return
    try:
        arrives(world, start, goal)
    except NavigationError as error:
        # No way; or one with less than a cell to spare, beside which the follower finds the robot in the inflation.
        assert error.code == 'NO_VALID_PATH' or least_clearance(world, start, goal) < LIMITS.radius + world.resolution


@pytest.mark.parametrize('yaw', [0.0, math.pi / 2, math.pi, -2.0])
def test_a_path_that_begins_behind_the_robot(yaw: float) -> None:
    arrives(OPEN, Pose(3.0, 3.0, 0.0), Pose(3.0 - math.cos(yaw), 3.0 - math.sin(yaw), yaw))


def test_paths_of_no_and_of_one_pose() -> None:
    costmap = Costmap(OPEN, INFLATION)
    with pytest.raises(NavigationError) as raised:
        PathFollower([], costmap, FOLLOWER)
    assert raised.value.code == 'INVALID_PATH'
    robot, _ = run(OPEN, Pose(3.0, 3.0, 0.0), PathFollower([Pose(3.02, 3.0, 1.5)], costmap, FOLLOWER))
    assert abs(wrap(robot.pose.yaw - 1.5)) < FOLLOWER.yaw_tolerance + 0.05


def test_a_robot_that_gets_nowhere_is_noticed() -> None:
    path = [Pose(3.0 + 0.05 * index, 3.0, 0.0) for index in range(40)]
    follower = PathFollower(path, Costmap(OPEN, INFLATION), FOLLOWER)
    stuck = Pose(3.0, 3.0, 0.0)
    times = numpy.arange(0.0, 30.0, CONTROL)
    with pytest.raises(NavigationError) as raised:
        for now in times:
            follower.step(stuck, float(now))
    assert raised.value.code == 'FAILED_TO_MAKE_PROGRESS'
    assert now == pytest.approx(FOLLOWER.progress_time, abs=2 * CONTROL)


def test_an_obstacle_on_the_path_ends_it_before_contact() -> None:
    world = drawn(*['.' * 40 + '##' + '.' * 40] * 60)
    path = [Pose(0.5 + 0.05 * index, 1.5, 0.0) for index in range(60)]
    with pytest.raises(NavigationError) as raised:
        run(world, path[0], PathFollower(path, Costmap(world, INFLATION), FOLLOWER))
    assert raised.value.code == 'NO_VALID_CONTROL'


@given(st.floats(-7.0, 7.0).filter(lambda angle: abs(angle) > 0.1))
def test_a_spin_turns_by_its_angle(angle: float) -> None:
    motion = SpinMotion(angle, 0.0)
    robot, _ = run(OPEN, Pose(3.0, 3.0, 2.0), motion)
    assert motion.turned == pytest.approx(angle, abs=0.12)
    assert robot.pose[:2] == (3.0, 3.0)


@given(st.floats(0.05, 1.5), st.sampled_from([-1.0, 1.0]))
def test_a_drive_covers_its_distance(distance: float, sign: float) -> None:
    motion = DriveMotion(sign * distance, sign * 0.2, 0.0, Costmap(OPEN, INFLATION))
    robot, _ = run(OPEN, Pose(3.0, 3.0, 0.7), motion)
    assert robot.pose.distance(Pose(3.0, 3.0, 0.0)) == pytest.approx(distance, abs=0.03)
    assert math.copysign(1.0, robot.pose.x - 3.0) == sign


def test_a_wall_behind_stops_backing_up() -> None:
    world = drawn(*['###' + '.' * 60] * 60)
    with pytest.raises(NavigationError) as raised:
        run(world, Pose(0.8, 1.5, 0.0), DriveMotion(-1.0, -0.2, 0.0, Costmap(world, INFLATION)))
    assert raised.value.code == 'COLLISION_AHEAD'


@pytest.mark.parametrize('motion', [SpinMotion(6.0, 1.0), DriveMotion(2.0, 0.1, 1.0, Costmap(OPEN, INFLATION))])
def test_the_allowance_of_time_ends_a_motion(motion: Motion) -> None:
    with pytest.raises(NavigationError) as raised:
        run(OPEN, Pose(1.0, 3.0, 0.0), motion, timeout=2.0)
    assert raised.value.code == 'TIMEOUT'
