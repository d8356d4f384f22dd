# SPDX-License-Identifier: BSD-3-Clause
"""Motions: what drives the robot, step by step, and how collisions are seen coming. Pure; a motion is asked for a
velocity whenever a new pose is known.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final, NamedTuple, Protocol

from flexbt_sim.world import Pose, drive

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


def collides(costmap: Costmap, pose: Pose, velocity: Velocity, seconds: float) -> bool:
    """Whether driving on like this for some time ends in an obstacle, or beside the map.

    Moving away from one that the robot overlaps already is no collision, and neither is a circle's turn on the spot.
    """
    inflation = costmap.inflation
    if velocity.linear == 0.0 and not inflation.corners:
        return False
    world = costmap.world
    way = (
        abs(velocity.linear) + abs(velocity.angular) * (inflation.outer_radius if inflation.corners else 0.0)
    ) * seconds
    steps = max(1, math.ceil(seconds / LOOK_AHEAD_STEP), math.ceil(way / world.resolution))
    overlap: float | None = None
    for step in range(1, steps + 1):
        ahead = drive(pose, *velocity, seconds * step / steps)
        if not world.contains(*world.cell(ahead.x, ahead.y)):
            return True
        before, overlap = overlap, costmap.overlap(ahead)
        if overlap > 0.0 and overlap >= (costmap.overlap(pose) if before is None else before):
            return True
    return False
