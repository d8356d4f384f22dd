# SPDX-License-Identifier: BSD-3-Clause
"""Where a robot can be put."""

from __future__ import annotations

from flexbt_sim.errors import SimulationError

from .plane import FARTHEST, OccupancyMap, Pose


def check_place(world: OccupancyMap, pose: Pose, radius: float) -> None:
    """Whether a robot of this radius, m, fits there.

    Raises:
        SimulationError: it does not; the message says why.
    """
    place = f'({pose.x:g}, {pose.y:g}, {pose.yaw:g})'
    if not pose.is_place:
        raise SimulationError(f'{place} is no pose; give finite numbers, of at most {FARTHEST:g}: m, m, rad')
    if not world.contains(*world.cell(pose.x, pose.y)):
        raise SimulationError(
            f'{place} is outside of the map of {world.width * world.resolution:g} x {world.height * world.resolution:g}'
            f' m with its corner at ({world.origin.x:g}, {world.origin.y:g})'
        )
    clearance = world.clearance(pose.x, pose.y)
    if clearance < radius:
        raise SimulationError(
            f'{place} is {clearance:.2f} m from an obstacle, and the robot has a radius of {radius:g} m'
        )
