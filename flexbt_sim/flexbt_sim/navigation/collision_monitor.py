# SPDX-License-Identifier: BSD-3-Clause
"""Slows a robot down before it collides, whatever commands it: the approach model of Nav2's collision monitor."""

from __future__ import annotations

from bisect import bisect_left

from flexbt_sim.costmaps import Costmap
from flexbt_sim.world import Pose

from .motions import LOOK_AHEAD_STEP, Velocity, collides


def slowed(costmap: Costmap, pose: Pose, command: Velocity, seconds: float) -> Velocity:
    """A command, scaled by the time until a collision in relation to the time that is looked ahead, s.

    Nothing is left of it when it collides within the first tenth of a second.
    """
    steps = max(1, round(seconds / LOOK_AHEAD_STEP))
    # Who collides within some time does so within any longer one.
    free = bisect_left(range(1, steps), True, key=lambda step: collides(costmap, pose, command, step * LOOK_AHEAD_STEP))
    scale = (free + 1) / steps if free else 0.0
    return Velocity(command.linear * scale, command.angular * scale)
