# SPDX-License-Identifier: BSD-3-Clause
"""A differential-drive robot on a map: limits, a watchdog, and walls that stop it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from flexbt_sim.geometry import Pose, drive
from flexbt_sim.occupancy_map import OccupancyMap

CONTACT_STEPS: Final = 8
"""Bisections by which the point of contact with a wall is found."""


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


class Robot:
    """State of the robot. Deterministic: it depends on the commands and the steps only."""

    def __init__(self, world: OccupancyMap, pose: Pose, limits: RobotLimits) -> None:
        self.limits = limits
        self._world = world
        self.pose = pose
        self.linear = 0.0
        self.angular = 0.0
        self.in_contact = False
        self._wanted = (0.0, 0.0)
        self._commanded_at: float | None = None

    def command(self, linear: float, angular: float, now: float) -> None:
        """Take a velocity command, m/s and rad/s, at a time in s. It is cut to the limits."""
        limits = self.limits
        self._wanted = (_clamp(linear, limits.linear_speed), _clamp(angular, limits.angular_speed))
        self._commanded_at = now

    def place(self, pose: Pose) -> None:
        """Put the robot somewhere, at rest."""
        self.pose = pose
        self.linear = self.angular = 0.0
        self.in_contact = False
        self._wanted = (0.0, 0.0)
        self._commanded_at = None

    @property
    def commanded_at(self) -> float | None:
        """Time of the last command."""
        return self._commanded_at

    def step(self, now: float, duration: float) -> None:
        """Move for ``duration`` seconds, the time being ``now``."""
        limits = self.limits
        stale = self._commanded_at is None or now - self._commanded_at > limits.watchdog
        linear, angular = (0.0, 0.0) if stale else self._wanted
        self.linear = _approach(self.linear, linear, limits.linear_acceleration * duration)
        self.angular = _approach(self.angular, angular, limits.angular_acceleration * duration)
        if self.linear == 0.0:
            # A circle that turns on the spot touches nothing new.
            self.pose = drive(self.pose, 0.0, self.angular, duration)
            return
        moved = drive(self.pose, self.linear, self.angular, duration)
        self.in_contact = not self._may_be(moved)
        if self.in_contact:
            moved = self._until_contact(duration)
            self.linear = 0.0
        self.pose = moved

    def _may_be(self, pose: Pose) -> bool:
        """Whether the robot fits there, or at least is not deeper in a wall than it is now (a bad start)."""
        clearance = self._world.clearance(pose.x, pose.y)
        return clearance >= self.limits.radius or clearance > self._world.clearance(self.pose.x, self.pose.y)

    def _until_contact(self, duration: float) -> Pose:
        low, high = 0.0, duration
        for _ in range(CONTACT_STEPS):
            middle = (low + high) / 2.0
            low, high = (
                (middle, high) if self._may_be(drive(self.pose, self.linear, self.angular, middle)) else (low, middle)
            )
        reached = drive(self.pose, self.linear, self.angular, low)
        return Pose(reached.x, reached.y, drive(self.pose, 0.0, self.angular, duration).yaw)


def _clamp(value: float, limit: float) -> float:
    return max(-limit, min(limit, value)) if value == value else 0.0  # not a number: stand still


def _approach(value: float, target: float, step: float) -> float:
    return min(target, value + step) if value < target else max(target, value - step)
