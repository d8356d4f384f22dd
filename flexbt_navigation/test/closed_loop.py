# SPDX-License-Identifier: BSD-3-Clause
"""A motion that drives a robot, as the nodes do it: poses at 33 Hz, commands that arrive later."""

from __future__ import annotations

import math
from collections import deque

from flexbt_navigation.controller.motions import STOP, Motion, Velocity
from flexbt_navigation.controller.path_follower import FollowerLimits, PathFollower
from flexbt_navigation.costmaps.costmap import Costmap, Inflation
from flexbt_navigation.errors import NavigationError
from flexbt_navigation.planner.planners import GridPlanner
from flexbt_sim.world import OccupancyMap, Pose, Robot, RobotModel, World, wrap
from flexbt_testing.worlds import room

PERIOD = 0.03
"""Time from pose to pose, s."""

MODEL = RobotModel(lidar=None)
RADIUS = MODEL.footprint.radius
FOLLOWER = FollowerLimits()

ROLLING = MODEL.drive.linear_speed**2 / (2.0 * MODEL.drive.linear_acceleration)
"""How far the robot rolls on while it brakes, m."""


class Run:
    """A robot alone on a map, and what became of the motions that drove it.

    ``code`` is that of the error that ended the last one, or '' when it was complete; ``touched`` says whether the
    robot has run into anything. Times in s.
    """

    def __init__(self, grid: OccupancyMap, start: Pose, model: RobotModel = MODEL) -> None:
        self.world = World(grid)
        self.robot: Robot = self.world.add('robot', model, start)
        self.code = ''
        self.commands: list[Velocity] = []
        self.poses: list[Pose] = []

    @property
    def now(self) -> float:
        return self.world.time

    @property
    def touched(self) -> bool:
        return self.robot.contacts > 0

    def go(self, motion: Motion, late: int = 0, until: float = math.inf, timeout: float = 300.0) -> Run:
        """Let a motion drive until it ends, or until a time; then the robot brakes. Commands are so many poses late."""
        under_way = deque([STOP] * late)
        end = self.now + timeout
        while self.now < until:
            assert self.now < end, f'not complete after {timeout} s'
            self.poses.append(self.robot.pose)
            try:
                velocity = motion.step(self.robot.pose, self.now)
            except NavigationError as error:
                self.code = error.code
                break
            if velocity is None:
                break
            self.commands.append(velocity)
            under_way.append(velocity)
            self._move(under_way.popleft())
        else:
            return self
        drive = self.robot.model.drive
        for _ in range(late + max(20, math.ceil(drive.linear_speed / drive.linear_acceleration / PERIOD))):
            self._move(under_way.popleft() if under_way else STOP)
        assert (self.robot.linear, self.robot.angular) == (0.0, 0.0)
        return self

    def _move(self, velocity: Velocity) -> None:
        self.robot.command(*velocity, self.now)
        self.world.step(PERIOD)


def run(grid: OccupancyMap, start: Pose, motion: Motion, late: int = 0) -> Run:
    """Drive a robot from a place on a map to the end of a motion."""
    return Run(grid, start).go(motion, late)


def assert_arrived(done: Run, goal: Pose) -> None:
    """At the goal, from where the robot may roll on while it brakes; within its limits; without a touch."""
    assert (done.code, done.touched) == ('', False)
    assert done.robot.pose.distance(goal) <= FOLLOWER.xy_tolerance + ROLLING
    assert abs(wrap(done.robot.pose.yaw - goal.yaw)) <= FOLLOWER.yaw_tolerance + 0.1
    assert all(0.0 <= command.linear <= FOLLOWER.speed for command in done.commands)
    assert all(abs(command.angular) <= FOLLOWER.angular_speed for command in done.commands)


def check_following(grid: OccupancyMap, start: Pose, goal: Pose, late: int) -> None:
    """Plan, and follow the plan. Raises NavigationError when there is none."""
    costmap = Costmap(grid, Inflation())
    path = GridPlanner(costmap).plan(start, goal)
    done = run(grid, start, PathFollower(path, costmap, FOLLOWER), late)
    if min(room(grid, pose.x, pose.y) for pose in path) >= RADIUS + 0.01:
        assert_arrived(done, goal)
    else:
        # With less than a centimetre to spare it may give up.
        assert done.code in ('', 'PATIENCE_EXCEEDED', 'FAILED_TO_MAKE_PROGRESS')
