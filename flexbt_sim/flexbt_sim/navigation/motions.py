# SPDX-License-Identifier: BSD-3-Clause
"""Motions: what drives the robot, step by step. Pure; each is asked for a velocity whenever a new pose is known.

The checks and their error codes are those of Nav2's behaviors (spin, backup, drive_on_heading).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final, NamedTuple, Protocol

from flexbt_sim.errors import NavigationError
from flexbt_sim.world import Pose, drive, wrap

from .costmap import Costmap

LOOK_AHEAD: Final = 2.0
"""How far ahead collisions are looked for, s."""

LOOK_AHEAD_STEP: Final = 0.1
"""Time, s, from one collision check to the next, where that is less than a cell of driving."""


class Velocity(NamedTuple):
    """m/s and rad/s."""

    linear: float
    angular: float


STOP: Final = Velocity(0.0, 0.0)


class Motion(Protocol):
    """Something that drives the robot."""

    def step(self, pose: Pose, now: float) -> Velocity | None:
        """The velocity to drive with, or None when the motion is complete.

        Raises:
            NavigationError: it cannot go on.
        """

    def update(self, costmap: Costmap) -> None:
        """There is a new map."""


@dataclass(frozen=True)
class TurnLimits:
    """Angular speeds of turns on the spot, rad/s, and their acceleration, rad/s²."""

    minimum: float = 0.1
    maximum: float = 1.0
    acceleration: float = 1.6

    def speed(self, remaining: float) -> float:
        """Speed at which to turn when so much is left: such that the robot can brake."""
        return min(self.maximum, max(self.minimum, math.sqrt(2.0 * self.acceleration * abs(remaining))))


class _Timed:
    """Time since the first step, and the allowance for it."""

    def __init__(self, allowance: float) -> None:
        self._allowance = allowance
        self._started: float | None = None

    def check(self, now: float) -> None:
        if self._started is None:
            self._started = now
        elif 0.0 < self._allowance < now - self._started:
            raise NavigationError('TIMEOUT', f'not complete within the allowance of {self._allowance:g} s')


class SpinMotion:
    """Turns on the spot by an angle."""

    def __init__(self, target: float, allowance: float, limits: TurnLimits | None = None) -> None:
        self._target = target
        self._limits = limits or TurnLimits()
        self._time = _Timed(allowance)
        self._last: float | None = None
        self.turned = 0.0

    def step(self, pose: Pose, now: float) -> Velocity | None:
        """A circle that turns on the spot collides with nothing that it does not touch already."""
        self._time.check(now)
        if self._last is not None:
            self.turned += wrap(pose.yaw - self._last)
        self._last = pose.yaw
        remaining = self._target - self.turned
        if abs(remaining) < 0.02 or remaining * self._target <= 0.0:
            return None
        return Velocity(0.0, math.copysign(self._limits.speed(remaining), remaining))

    def update(self, costmap: Costmap) -> None:
        """Whatever the map, a circle turns on the spot."""


class DriveMotion:
    """Drives straight, forward or backward, for a distance."""

    def __init__(self, distance: float, speed: float, allowance: float, costmap: Costmap) -> None:
        """``distance`` and ``speed`` have the same sign, negative for backward."""
        self._distance = abs(distance)
        self._speed = speed
        self._costmap = costmap
        self._time = _Timed(allowance)
        self._start: Pose | None = None
        self.driven = 0.0

    def step(self, pose: Pose, now: float) -> Velocity | None:
        self._time.check(now)
        if self._start is None:
            self._start = pose
        self.driven = self._start.distance(pose)
        remaining = self._distance - self.driven
        if remaining <= 0.0:
            return None
        velocity = Velocity(self._speed, 0.0)
        seconds = min(LOOK_AHEAD, remaining / abs(self._speed))
        if collides(self._costmap, pose, velocity, seconds):
            raise NavigationError('COLLISION_AHEAD', f'an obstacle is within {seconds:.1f} s of driving')
        return velocity

    def update(self, costmap: Costmap) -> None:
        self._costmap = costmap


def collides(costmap: Costmap, pose: Pose, velocity: Velocity, seconds: float) -> bool:
    """Whether driving on like this for some time ends in an obstacle, or beside the map.

    Moving away from one that the robot overlaps already is no collision, and neither is turning on the spot.
    """
    if velocity.linear == 0.0:
        return False
    world = costmap.world
    steps = max(1, math.ceil(seconds / LOOK_AHEAD_STEP), math.ceil(abs(velocity.linear) * seconds / world.resolution))
    here = pose
    for step in range(1, steps + 1):
        ahead = drive(pose, *velocity, seconds * step / steps)
        if costmap.in_collision(ahead) and not (
            world.contains(*world.cell(ahead.x, ahead.y))
            and world.clearance(ahead.x, ahead.y) > world.clearance(here.x, here.y)
        ):
            return True
        here = ahead
    return False
