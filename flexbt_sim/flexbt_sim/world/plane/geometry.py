# SPDX-License-Identifier: BSD-3-Clause
"""Poses in the plane."""

from __future__ import annotations

import math
from typing import Final, NamedTuple

FARTHEST: Final = 1e7
"""Greatest coordinate of a place, m: with greater ones distances and cells cannot be computed any more."""


class Pose(NamedTuple):
    """Position in m and heading in rad, in the frame of the map."""

    x: float
    y: float
    yaw: float

    @property
    def is_place(self) -> bool:
        """Whether these are numbers, and within FARTHEST."""
        return all(map(math.isfinite, self)) and max(abs(self.x), abs(self.y)) <= FARTHEST

    def distance(self, other: Pose) -> float:
        """Distance of the positions, m."""
        return math.hypot(other.x - self.x, other.y - self.y)

    def bearing(self, x: float, y: float) -> float:
        """Direction of a point relative to the heading, rad in (-pi, pi]."""
        return wrap(math.atan2(y - self.y, x - self.x) - self.yaw)


def wrap(angle: float) -> float:
    """The same angle in (-pi, pi]."""
    wrapped = math.remainder(angle, math.tau)
    return math.pi if wrapped == -math.pi else wrapped


def drive(pose: Pose, linear: float, angular: float, duration: float) -> Pose:
    """The pose after driving at constant speeds (m/s, rad/s) for a time (s): exactly, along the arc."""
    half = angular * duration / 2.0
    chord = linear * duration * (math.sin(half) / half if half else 1.0)
    return Pose(
        pose.x + chord * math.cos(pose.yaw + half),
        pose.y + chord * math.sin(pose.yaw + half),
        wrap(pose.yaw + 2.0 * half),
    )


def compose(one: Pose, other: Pose) -> Pose:
    """The pose ``other``, given in the frame of ``one``, in the frame that ``one`` is given in."""
    cos, sin = math.cos(one.yaw), math.sin(one.yaw)
    return Pose(one.x + other.x * cos - other.y * sin, one.y + other.x * sin + other.y * cos, wrap(one.yaw + other.yaw))


def inverse(pose: Pose) -> Pose:
    """The pose of the frame that a pose is given in, in the frame of the pose."""
    cos, sin = math.cos(pose.yaw), math.sin(pose.yaw)
    return Pose(-pose.x * cos - pose.y * sin, pose.x * sin - pose.y * cos, wrap(-pose.yaw))
