# SPDX-License-Identifier: BSD-3-Clause
"""A differential-drive robot on a map: limits, a watchdog, and walls that stop it."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

from .plane import OccupancyMap, Pose, drive

TICK: Final = 0.01
"""Longest time, s, for which speeds are taken as constant."""

COLLISION_CHECK_DISTANCE: Final = 0.002
"""How far, m, the robot goes from one collision check to the next when it is near one."""


@dataclass(frozen=True)
class RobotLimits:
    """Limits of the robot; the defaults are those of a TurtleBot3 waffle.

    Speeds in m/s and rad/s, accelerations in m/s² and rad/s², radius in m; ``watchdog`` is the time in s without a
    command after which the robot brakes.
    """

    linear_speed: float = 0.26
    angular_speed: float = 1.82
    linear_acceleration: float = 2.5
    angular_acceleration: float = 3.2
    radius: float = 0.22
    watchdog: float = 0.5


class MapRobot:
    """State of the robot. Deterministic: it depends on the commands and the steps only.

    ``in_contact`` says whether an obstacle has ended the last movement; the robot has stopped there, and can turn.
    """

    def __init__(self, world: OccupancyMap, pose: Pose, limits: RobotLimits) -> None:
        self.limits = limits
        self._world = world
        self.place(pose)

    def place(self, pose: Pose) -> None:
        """Put the robot somewhere, at rest."""
        self.pose = pose
        self.linear = self.angular = 0.0
        self.in_contact = False
        self._wanted = (0.0, 0.0)
        self._commanded_at: float | None = None

    def command(self, linear: float, angular: float, now: float) -> None:
        """Take a velocity command, m/s and rad/s, at a time in s.

        It is cut to the limits. One that is not finite is not followed in any part: it means to stop.
        """
        if not (math.isfinite(linear) and math.isfinite(angular)):
            linear = angular = 0.0
        limits = self.limits
        self._wanted = (_clamp(linear, limits.linear_speed), _clamp(angular, limits.angular_speed))
        self._commanded_at = now

    @property
    def commanded_at(self) -> float | None:
        """Time of the last command."""
        return self._commanded_at

    def step(self, now: float, duration: float) -> None:
        """Move for ``duration`` seconds, however many, until the time is ``now``."""
        ticks = max(1, math.ceil(duration / TICK - 1e-6))
        tick = duration / ticks
        for left in reversed(range(ticks)):
            linear, angular = self._wanted_at(now - left * tick)
            self.linear = _approach(self.linear, linear, self.limits.linear_acceleration * tick)
            self.angular = _approach(self.angular, angular, self.limits.angular_acceleration * tick)
            if self.linear == self.angular == linear == angular == 0.0:
                return  # and so it stays
            self._move(tick)

    def _wanted_at(self, time: float) -> tuple[float, float]:
        stale = self._commanded_at is None or time - self._commanded_at > self.limits.watchdog
        return (0.0, 0.0) if stale else self._wanted

    def _move(self, duration: float) -> None:
        """At the present speeds. A circle that turns on the spot touches nothing new."""
        speed, left = abs(self.linear), duration
        self.in_contact = self.in_contact and speed == 0.0
        while speed > 0.0 and left > 0.0:
            unhindered = self._world.is_free(self.pose.x, self.pose.y, self.limits.radius + speed * left)
            step = left if unhindered else min(left, COLLISION_CHECK_DISTANCE / speed)
            ahead = drive(self.pose, self.linear, self.angular, step)
            if not unhindered and not self._may_be(ahead):
                self.in_contact = True
                self.linear = speed = 0.0
            else:
                self.pose = ahead
                left -= step
        self.pose = drive(self.pose, 0.0, self.angular, left)

    def _may_be(self, pose: Pose) -> bool:
        """Whether the robot fits there, or at least is less deep in an obstacle than it is now (a bad start)."""
        world = self._world
        return world.is_free(pose.x, pose.y, self.limits.radius) or (
            world.clearance(pose.x, pose.y) > world.clearance(self.pose.x, self.pose.y)
        )


def _clamp(value: float, limit: float) -> float:
    return max(-limit, min(limit, value))


def _approach(value: float, target: float, step: float) -> float:
    return min(target, value + step) if value < target else max(target, value - step)
