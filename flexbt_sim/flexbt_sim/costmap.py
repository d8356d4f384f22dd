# SPDX-License-Identifier: BSD-3-Clause
"""The inflated costmap that planning and collision checks use, with Nav2's cost law."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy
from numpy.typing import NDArray

from flexbt_sim.geometry import Pose
from flexbt_sim.occupancy_map import UNKNOWN, OccupancyMap

LETHAL: Final = 254
INSCRIBED: Final = 253
_HIGHEST_INFLATED: Final = 252.0


@dataclass(frozen=True)
class Inflation:
    """How costs fall off round obstacles.

    ``robot_radius`` in m: within it of an obstacle the robot's centre is in collision. ``radius`` in m: how far costs
    reach; ``scaling`` in 1/m: how fast they fall off, as exp(-scaling * distance beyond the robot's radius).
    """

    robot_radius: float = 0.22
    radius: float = 0.70
    scaling: float = 3.0


class Costmap:
    """Cost of each cell for the centre of the robot: 0 to 252, 253 in collision, 254 obstacle. Unknown is free."""

    def __init__(self, world: OccupancyMap, inflation: Inflation) -> None:
        self.world = world
        self.inflation = inflation
        distance = world.distances
        beyond = numpy.maximum(distance - inflation.robot_radius, 0.0)
        costs = numpy.where(
            distance <= inflation.radius, _HIGHEST_INFLATED * numpy.exp(-inflation.scaling * beyond), 0.0
        )
        costs[distance <= inflation.robot_radius] = INSCRIBED
        costs[world.obstacles] = LETHAL
        self.costs: NDArray[numpy.uint8] = costs.astype(numpy.uint8)
        self.unknown: NDArray[numpy.bool_] = world.cells == UNKNOWN

    def cost(self, x: float, y: float) -> int | None:
        """Cost at a point of the map frame; None outside of the map."""
        row, column = self.world.cell(x, y)
        return int(self.costs[row, column]) if self.world.contains(row, column) else None

    def in_collision(self, pose: Pose) -> bool:
        """Whether the robot would touch an obstacle there, or be outside of the map."""
        cost = self.cost(pose.x, pose.y)
        return cost is None or cost >= INSCRIBED

    def line_costs(self, start: tuple[float, float], end: tuple[float, float]) -> NDArray[numpy.int64]:
        """Costs along a straight line between two grid positions (row, column), sampled twice per cell."""
        count = max(2, math.ceil(2.0 * math.dist(start, end)) + 1)
        rows = numpy.rint(numpy.linspace(start[0], end[0], count)).astype(int)
        columns = numpy.rint(numpy.linspace(start[1], end[1], count)).astype(int)
        return self.costs[rows, columns].astype(numpy.int64)
