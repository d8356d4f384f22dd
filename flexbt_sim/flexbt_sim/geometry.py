# SPDX-License-Identifier: BSD-3-Clause
"""Poses in the plane."""

from __future__ import annotations

import math
from typing import NamedTuple


class Pose(NamedTuple):
    """Position in m and heading in rad, in the frame of the map."""

    x: float
    y: float
    yaw: float

    def distance(self, other: Pose) -> float:
        """Distance of the positions, m."""
        return math.hypot(other.x - self.x, other.y - self.y)

    def bearing(self, x: float, y: float) -> float:
        """Direction of a point relative to the heading, rad in (-pi, pi]."""
        return wrap(math.atan2(y - self.y, x - self.x) - self.yaw)


def wrap(angle: float) -> float:
    """The same angle in (-pi, pi]."""
    return math.pi - (math.pi - angle) % (2.0 * math.pi)


def drive(pose: Pose, linear: float, angular: float, duration: float) -> Pose:
    """The pose after driving at constant speeds (m/s, rad/s) for a time (s): exactly, along the arc."""
    turn = angular * duration
    if abs(turn) < 1e-9:
        middle = pose.yaw + turn / 2.0
        return Pose(
            pose.x + linear * duration * math.cos(middle),
            pose.y + linear * duration * math.sin(middle),
            wrap(pose.yaw + turn),
        )
    radius = linear / angular
    yaw = pose.yaw + turn
    return Pose(
        pose.x + radius * (math.sin(yaw) - math.sin(pose.yaw)),
        pose.y - radius * (math.cos(yaw) - math.cos(pose.yaw)),
        wrap(yaw),
    )
