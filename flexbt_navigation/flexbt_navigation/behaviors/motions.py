# SPDX-License-Identifier: BSD-3-Clause
"""The behaviors of Nav2's behavior server that move the robot: spin, backup, drive_on_heading and assisted_teleop.

Checks, speeds and error codes are those of Nav2. docs/reference/navigation.md lists the differences.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Final

from flexbt_navigation.controller.motions import (
    LATENCY,
    LOOK_AHEAD,
    LOOK_AHEAD_STEP,
    STOP,
    KeepingApart,
    Motion,
    TurnLimits,
    Velocity,
    collides,
    slowed,
)
from flexbt_navigation.costmaps.costmap import Costmap
from flexbt_navigation.errors import NavigationError
from flexbt_sim.world.plane.geometry import Pose, drive, wrap

SPIN_LIMITS: Final = TurnLimits(minimum=0.4, maximum=1.0, acceleration=3.2)
"""Nav2's min_rotational_vel, max_rotational_vel and rotational_acc_lim."""

MOST_COMMAND: Final = 10.0
"""Maximum of an operator's command, m/s and rad/s: collisions are looked for all along its way."""

TELEOP_PROJECTION: Final = 1.0
"""Time for which assisted_teleop looks ahead, s: Nav2's projection_time."""


class _TimedMotion(Motion):
    """A motion with a time allowance, s, 0 for no limit; ``elapsed`` is the time since its first step."""

    def __init__(self, allowance: float, costmap: Costmap) -> None:
        self._costmap = costmap
        self._allowance = allowance
        self._started: float | None = None
        self.elapsed = 0.0

    def _check_time(self, now: float) -> None:
        if self._started is None:
            self._started = now
        self.elapsed = now - self._started
        if 0.0 < self._allowance < self.elapsed:
            raise NavigationError('TIMEOUT', f'not complete within the allowance of {self._allowance:g} s')

    def _kept_apart(self, apart: KeepingApart, pose: Pose, velocity: Velocity, now: float) -> Velocity:
        """Return the limited velocity. Raises NavigationError COLLISION_AHEAD when a movable obstacle is too near."""
        apart.look(self._costmap, pose, now)
        limited = apart.limited(self._costmap, pose, velocity)
        if limited is None:
            raise NavigationError('COLLISION_AHEAD', 'something that may move is beside the robot')
        return limited


ROLL_TIME: Final = 0.1
"""Minimum time for which the robot may roll on beyond its distance, s: until the command to stop arrives, and while it
brakes."""


def _roll_time(speed: float, deceleration: float) -> float:
    """Return the time, s, in which a robot at this speed would come as far as it rolls on."""
    return max(ROLL_TIME, LATENCY + abs(speed) / (2.0 * deceleration))


class SpinMotion(_TimedMotion):
    """A turn on the spot by an angle, rad; ``turned`` so far."""

    def __init__(self, target: float, allowance: float, costmap: Costmap, limits: TurnLimits = SPIN_LIMITS) -> None:
        super().__init__(allowance, costmap)
        self._target = target
        self._limits = limits
        self._apart = KeepingApart(limits.maximum * costmap.inflation.outer_radius)
        self._last: float | None = None
        self.turned = 0.0

    def step(self, pose: Pose, now: float) -> Velocity | None:
        """See :class:`Motion`.

        Raises:
            NavigationError: TIMEOUT, or COLLISION_AHEAD when the robot touches an obstacle, or would while it turns or
                brakes.
        """
        self._check_time(now)
        if self._last is not None:
            self.turned += wrap(pose.yaw - self._last)
        self._last = pose.yaw
        remaining = abs(self._target) - abs(self.turned)
        if remaining < 1e-6:
            return None
        angular = math.copysign(self._limits.speed(remaining), self._target)
        roll = _roll_time(angular, self._limits.acceleration)
        seconds = min(max(LOOK_AHEAD, roll), remaining / abs(angular) + roll)
        steps = math.ceil(seconds / LOOK_AHEAD_STEP)
        ahead = (drive(pose, 0.0, angular, seconds * step / steps) for step in range(steps + 1))
        if any(map(self._costmap.in_collision, ahead)):
            raise NavigationError('COLLISION_AHEAD', f'an obstacle is within {seconds:.1f} s of turning')
        return self._kept_apart(self._apart, pose, Velocity(0.0, angular), now)


class DriveMotion(_TimedMotion):
    """A drive straight ahead, forward or backward, for a distance."""

    def __init__(
        self, distance: float, speed: float, allowance: float, costmap: Costmap, deceleration: float = math.inf
    ) -> None:
        """``distance`` and ``speed`` have the same sign, negative for backward; ``deceleration`` in m/s²."""
        super().__init__(allowance, costmap)
        self._distance = abs(distance)
        self._speed = speed
        self._roll = _roll_time(speed, deceleration)
        self._apart = KeepingApart(abs(speed))
        self._start: Pose | None = None
        self.driven = 0.0

    def step(self, pose: Pose, now: float) -> Velocity | None:
        self._check_time(now)
        if self._start is None:
            self._start = pose
        self.driven = self._start.distance(pose)
        remaining = self._distance - self.driven
        if remaining <= 0.0:
            return None
        velocity = Velocity(self._speed, 0.0)
        seconds = min(max(LOOK_AHEAD, self._roll), remaining / abs(self._speed) + self._roll)
        if collides(self._costmap, pose, velocity, seconds):
            raise NavigationError('COLLISION_AHEAD', f'an obstacle is within {seconds:.1f} s of driving')
        return self._kept_apart(self._apart, pose, velocity, now)


class AssistedTeleopMotion(_TimedMotion):
    """A drive under an operator's commands, slowed down before collisions, until the operator reports it as done."""

    def __init__(self, command: Callable[[], Velocity], allowance: float, costmap: Costmap) -> None:
        """``command()`` returns the operator's current command."""
        super().__init__(allowance, costmap)
        self._command = command
        self._is_done = False

    def finish(self) -> None:
        """Complete the motion, when the operator reports that it is done."""
        self._is_done = True

    def step(self, pose: Pose, now: float) -> Velocity | None:
        """See :class:`Motion`.

        As in Nav2, the command is scaled by the ratio of the time to collision to the projection time. It becomes zero
        when the time to collision is a tenth of a second.

        Raises:
            NavigationError: TIMEOUT.
        """
        self._check_time(now)
        if self._is_done:
            return None
        command = Velocity(*(max(-MOST_COMMAND, min(MOST_COMMAND, part)) for part in self._command()))
        if command == STOP:
            return STOP
        return slowed(self._costmap, pose, command, TELEOP_PROJECTION)
