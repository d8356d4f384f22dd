# SPDX-License-Identifier: BSD-3-Clause
"""The inflated costmap that planning and collision checks use, with Nav2's cost law."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy
from numpy.typing import NDArray
from scipy import ndimage

from flexbt_sim.world import OccupancyMap, Pose

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


Position = tuple[float, float]
"""Row and column of a point, in cells; see :meth:`flexbt_sim.world.occupancy_map.OccupancyMap.grid_position`."""


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

    def in_collision(self, pose: Pose) -> bool:
        """Whether the robot would overlap an obstacle there, or its centre be outside of the map."""
        world = self.world
        return not (
            world.contains(*world.cell(pose.x, pose.y)) and world.is_free(pose.x, pose.y, self.inflation.robot_radius)
        )

    def is_clear(self, start: Position, end: Position, radius: float) -> bool:
        """Whether a circle, of a radius in m, can move straight from one position to the other.

        Never wrongly true; wrongly false at most where it has less than a cell to spare. Distances are interpolated
        between points half a cell apart. What that and the gaps between the samples may hide is bounded by the squares
        of the spacings, since the square of the distance from a point has the constant curvature 2.
        """
        world = self.world
        points, spacing = along(start, end)
        distances = ndimage.map_coordinates(world.half_cell_distances, 2.0 * points, order=1, mode='nearest')
        between_points = 2.0 * (world.resolution / 4.0) ** 2
        between_samples = (spacing * world.resolution / 2.0) ** 2
        return bool(distances.min() >= math.sqrt(radius**2 + between_points + between_samples))

    def mean_cost(self, start: Position, end: Position) -> float:
        """Mean cost of the cells along a straight line between two positions on the map."""
        samples = max(1, math.ceil(8.0 * math.dist(start, end)))
        parts = (numpy.arange(samples) + 0.5) / samples
        points = numpy.outer(start, 1.0 - parts) + numpy.outer(end, parts)
        rows, columns = numpy.minimum(points.astype(int), [[self.world.height - 1], [self.world.width - 1]])
        return float(self.costs[rows, columns].mean())


def along(start: Position, end: Position) -> tuple[NDArray[numpy.float64], float]:
    """Evenly spaced positions from start to end, shape (2, n), and their spacing, at most half a cell."""
    intervals = max(1, math.ceil(2.0 * math.dist(start, end)))
    return numpy.linspace(start, end, intervals + 1, axis=1), math.dist(start, end) / intervals
