# SPDX-License-Identifier: BSD-3-Clause
"""Navigation of robots of a simulated world, without ROS: for notebooks, tests and figures.

Planner, costmaps and controller are those of the navigation servers. If they fail, the navigator recovers as Nav2's
default tree does (navigate_to_pose_w_replanning_and_recovery).
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Generator
from dataclasses import dataclass, field
from itertools import cycle
from typing import Final, TypeVar

import numpy

from flexbt_navigation.behaviors.motions import SPIN_LIMITS, DriveMotion, SpinMotion
from flexbt_navigation.controller.motions import STOP, Motion, Velocity
from flexbt_navigation.controller.path_follower import FollowerLimits, PathFollower
from flexbt_navigation.costmaps.costmap import Costmap, Inflation
from flexbt_navigation.costmaps.layers import LayeredCostmap, Observation, known_tolerance, local_size
from flexbt_navigation.planner.planners import planner_for
from flexbt_sim.world.plane.geometry import Pose, compose
from flexbt_sim.world.plane.occupancy_map import OccupancyMap
from flexbt_sim.world.robot import COMMAND_PERIOD
from flexbt_sim.world.world import World

from .errors import NavigationError

PLAN_PERIOD: Final = 1.0
GLOBAL_PERIOD: Final = 1.0
LOCAL_PERIOD: Final = 0.2
RETRIES: Final = 6
"""Maximum number of recoveries."""

RECOVERABLE: Final = frozenset(
    {'UNKNOWN', 'NO_VALID_PATH', 'TIMEOUT', 'PATIENCE_EXCEEDED', 'FAILED_TO_MAKE_PROGRESS', 'NO_VALID_CONTROL'}
)
"""Errors for which Nav2's WouldAPlannerRecoveryHelp and WouldAControllerRecoveryHelp succeed."""

T = TypeVar('T')
Steps = Generator[None, None, T]
"""A generator that drives a robot, with one COMMAND_PERIOD between two commands."""


@dataclass
class Trip:
    """The result of a goal: the ``code`` of the error that ended it, '' if it was reached; the time, s, and the
    distance, m."""

    goal: Pose
    code: str = ''
    seconds: float = 0.0
    length: float = 0.0
    plans: int = 0
    recoveries: int = 0
    contacts: int = 0
    errors: list[str] = field(default_factory=list)


class Navigator:
    """A navigator of one robot. :meth:`navigate` drives it to a goal; :meth:`start` and :meth:`step` do so together
    with other robots. Everything else in the world keeps moving meanwhile."""

    def __init__(
        self,
        world: World,
        robot: str,
        static: Costmap | OccupancyMap | None = None,
        limits: FollowerLimits | None = None,
        latency: int = 1,
        plan_seconds: float = 0.0,
    ) -> None:
        """Create a navigator. ``static`` is the map it knows from the start, by default that of the world with its
        no-go zones.

        A command takes effect after ``latency`` periods, as it does between nodes. A plan is ready after
        ``plan_seconds`` of simulated time: between nodes, in a world that is faster than real time, a plan may be old.
        """
        known = static or world.known_map
        if known is None:
            raise NavigationError('UNKNOWN', 'there is no map: give a world that has one, or the map that is known')
        self._world = world
        self._robot = world.robots[robot]
        self._limits = limits or FollowerLimits.of(self._robot.model.drive)
        costmap = known if isinstance(known, Costmap) else Costmap(known, Inflation.of(self._robot.model.footprint))
        lidar = self._robot.model.lidar
        tolerance = known_tolerance(lidar)
        self._global = LayeredCostmap(costmap, tolerance=tolerance)
        self._local = LayeredCostmap(costmap, local_size(costmap.inflation), tolerance)
        self._observed = {LOCAL_PERIOD: -math.inf, GLOBAL_PERIOD: -math.inf}
        self._plan_seconds = plan_seconds
        self._path: list[Pose] = []
        self._under_way = deque([STOP] * latency)
        if lidar is not None:
            self._angles = lidar.angle_min + lidar.angle_increment * numpy.arange(lidar.beams, dtype=numpy.float64)
        self._steps: Steps[None] | None = None
        self.on_step: Callable[[], None] = lambda: None

    def navigate(self, goal: Pose, timeout: float = 3600.0) -> Trip:
        """Drive to a goal; ``timeout`` in s of simulated time."""
        trip = self.start(goal, timeout)
        while self.step():
            self._world.step(COMMAND_PERIOD)
        return trip

    def start(self, goal: Pose, timeout: float = 3600.0) -> Trip:
        """Start driving to a goal, which replaces the previous one. The trip gets the result at the end."""
        trip = Trip(goal)
        self._steps = self._drive_to(trip, timeout)
        return trip

    def step(self) -> bool:
        """Send the next command and return True, or return False if the trip is over. Let a COMMAND_PERIOD of simulated
        time pass before the next call."""
        if self._steps is not None and next(self._steps, self) is self:
            self._steps = None
        return self._steps is not None

    def _drive_to(self, trip: Trip, timeout: float) -> Steps[None]:
        world, robot = self._world, self._robot
        began, contacts, until = world.time, robot.contacts, world.time + timeout
        recoveries = cycle((self._clear, self._spin, self._wait, self._back_up))
        while True:
            try:
                yield from self._follow(trip, until)
            except NavigationError as error:
                trip.code = error.code
                trip.errors.append(f'{error.code}: {error}')
            else:
                trip.code = ''
            if trip.code not in RECOVERABLE or trip.recoveries == RETRIES or world.time >= until:
                break
            trip.recoveries += 1
            while not (yield from next(recoveries)()):  # as RoundRobin: the next one follows a failure
                pass
        yield from self._rest()
        trip.seconds, trip.contacts = world.time - began, robot.contacts - contacts

    def _follow(self, trip: Trip, until: float) -> Steps[None]:
        """Plan every second and follow the newest path. After a failure, retry once with a cleared costmap."""
        follower: PathFollower | None = None
        asked, plan = -math.inf, None
        may_retry = True
        while self._world.time < until:
            now = self._world.time
            if plan is None and now - asked >= PLAN_PERIOD - 1e-6:
                asked, plan = now, self._planned(trip)
            if plan is not None and now - asked >= self._plan_seconds - 1e-6:
                follower, plan = PathFollower(plan, self._local.costmap, self._limits, follower), None
            if follower is None:
                yield from self._drive(STOP)
                continue
            try:
                if (yield from self._move(follower, trip)):
                    return
            except NavigationError as error:
                if error.code not in RECOVERABLE or not may_retry:
                    raise
                trip.errors.append(f'{error.code}: {error}')
                may_retry = False
                self._local.clear()
                yield from self._drive(STOP)
                follower, asked, plan = None, -math.inf, None
        raise NavigationError('TIMEOUT', 'the goal is not reached in time')

    def _planned(self, trip: Trip) -> list[Pose]:
        trip.plans += 1
        planner = planner_for(self._global.costmap, self._limits.steering)
        try:
            self._path = planner.plan(self._robot.estimate, trip.goal, before=[self._path])
        except NavigationError as error:
            if error.code not in RECOVERABLE:
                raise
            self._global.clear()
            self._path = planner.plan(self._robot.estimate, trip.goal, before=[self._path])
        return self._path

    def _move(self, motion: Motion, trip: Trip | None = None) -> Steps[bool]:
        """Run one period of a motion; return whether it is complete."""
        velocity = motion.step(self._robot.estimate, self._world.time)
        before = self._robot.pose
        yield from self._drive(velocity or STOP)
        if trip is not None:
            trip.length += before.distance(self._robot.pose)
        return velocity is None

    def _drive(self, velocity: Velocity) -> Steps[None]:
        self._under_way.append(velocity)
        self._robot.command(*self._under_way.popleft(), self._world.time)
        yield
        self._observe()
        self.on_step()

    def _observe(self) -> None:
        scan, lidar = self._robot.scan, self._robot.model.lidar
        if scan is None or lidar is None or scan.time < self._world.time - COMMAND_PERIOD / 2.0:
            return
        robot = self._robot.estimate
        ranges = scan.ranges.astype(numpy.float64)
        observation = Observation(compose(robot, lidar.pose), self._angles, ranges, lidar.range_max)
        for period, layers in ((LOCAL_PERIOD, self._local), (GLOBAL_PERIOD, self._global)):
            if scan.time - self._observed[period] >= period - 0.01:
                self._observed[period] = scan.time
                layers.observe(observation, robot)

    # -- recoveries --------------------------------------------------------------------------------------------------

    def _clear(self) -> Steps[bool]:
        self._local.clear()
        self._global.clear()
        yield from ()
        return True

    def _spin(self) -> Steps[bool]:
        if self._limits.turning_radius:
            return False
        limits = SPIN_LIMITS.braking_with(self._limits.angular_acceleration)
        return (yield from self._complete(SpinMotion(1.57, 10.0, self._local.costmap, limits)))

    def _back_up(self) -> Steps[bool]:
        motion = DriveMotion(-0.3, -0.15, 10.0, self._local.costmap, self._limits.linear_acceleration)
        return (yield from self._complete(motion))

    def _wait(self) -> Steps[bool]:
        until = self._world.time + 5.0
        while self._world.time < until:
            yield from self._drive(STOP)
        return True

    def _complete(self, motion: Motion) -> Steps[bool]:
        """Run a recovery; return whether it succeeds."""
        try:
            while not (yield from self._move(motion)):
                pass
        except NavigationError:
            yield from self._drive(STOP)
            return False
        return True

    def _rest(self) -> Steps[None]:
        while any(velocity != STOP for velocity in self._under_way) or self._robot.linear or self._robot.angular:
            yield from self._drive(STOP)
