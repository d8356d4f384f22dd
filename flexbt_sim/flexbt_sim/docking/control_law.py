# SPDX-License-Identifier: BSD-3-Clause
"""The smooth control law of Park and Kuipers (ICRA 2011), by which Nav2's graceful controller gets to a pose."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

from flexbt_sim.navigation import Velocity
from flexbt_sim.world import Pose, wrap


@dataclass(frozen=True)
class ControlLaw:
    """Gains and bounds, with the defaults of Nav2's docking server. Speeds in m/s and rad/s, the radius in m.

    ``slow_gain`` is k1 of the paper (k_phi), ``fast_gain`` k2 (k_delta); ``beta`` and ``exponent`` (lambda) slow the
    robot down where the path bends. Within ``slowdown_radius`` of the pose it gets slower. No bend is narrower than
    ``turning_radius``, which is 0 for a robot that turns on the spot.
    """

    slow_gain: float = 3.0
    fast_gain: float = 2.0
    beta: float = 0.4
    exponent: float = 2.0
    least_speed: float = 0.1
    speed: float = 0.25
    angular_speed: float = 0.75
    slowdown_radius: float = 0.25
    turning_radius: float = 0.0


_SMALLEST: Final = 1e-6


def velocity_to(target: Pose, pose: Pose, law: ControlLaw, *, backward: bool = False) -> Velocity:
    """The velocity that leads from a pose to another one, forward or backward; at the other one it is arbitrary."""
    dx, dy = target.x - pose.x, target.y - pose.y
    distance = max(math.hypot(dx, dy), _SMALLEST)
    # Backward, it is the way of a robot that looks the other way.
    flip = math.pi if backward else 0.0
    sight = math.atan2(dy, dx)
    heading = wrap(pose.yaw + flip - sight)
    goal = wrap(target.yaw + flip - sight)
    wanted = math.atan(-law.slow_gain * goal)
    curvature = (
        -(
            law.fast_gain * (heading - wanted)
            + (1.0 + law.slow_gain / (1.0 + (law.slow_gain * goal) ** 2)) * math.sin(heading)
        )
        / distance
    )
    sharpest = 1.0 / law.turning_radius if law.turning_radius else math.inf
    curvature = max(-sharpest, min(sharpest, curvature))
    speed = law.speed / (1.0 + law.beta * abs(curvature) ** law.exponent)
    speed = max(law.least_speed, min(speed, law.speed * distance / law.slowdown_radius))
    angular = max(-law.angular_speed, min(law.angular_speed, speed * curvature))
    if abs(curvature) > _SMALLEST:
        speed = angular / curvature
    return Velocity(-speed if backward else speed, angular)
