# SPDX-License-Identifier: BSD-3-Clause
"""A planar lidar, by marching along all beams at once through the field of distances."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy
from numpy.typing import NDArray

from flexbt_sim.geometry import Pose
from flexbt_sim.occupancy_map import OccupancyMap


@dataclass(frozen=True)
class LidarModel:
    """``beams`` evenly round the robot, counter-clockwise from straight ahead.

    Ranges in m; ``noise`` is the standard deviation of one, in m.
    """

    beams: int = 360
    range_min: float = 0.12
    range_max: float = 3.5
    noise: float = 0.01

    @property
    def angle_increment(self) -> float:
        """Angle between two beams, rad."""
        return 2.0 * math.pi / self.beams


class Lidar:
    """Scans of a map. The noise depends on the seed and the number of the scan only."""

    def __init__(self, world: OccupancyMap, model: LidarModel, seed: int) -> None:
        self._world = world
        self.model = model
        self._random = numpy.random.default_rng(seed)
        self._angles = numpy.arange(model.beams) * model.angle_increment

    def scan(self, pose: Pose) -> NDArray[numpy.float32]:
        """Range of each beam, m; infinite where nothing is within range."""
        world, model = self._world, self.model
        # In units of cells, in the frame of the grid.
        row0, column0 = _grid_position(world, pose)
        angles = self._angles + pose.yaw - world.origin.yaw
        cos, sin = numpy.cos(angles), numpy.sin(angles)
        travelled = numpy.zeros(model.beams)
        limit = model.range_max / world.resolution
        open_beams = numpy.arange(model.beams)
        hit = numpy.zeros(model.beams, bool)
        distances = world.distances
        while open_beams.size:
            t = travelled[open_beams]
            rows = numpy.floor(row0 + t * sin[open_beams]).astype(int)
            columns = numpy.floor(column0 + t * cos[open_beams]).astype(int)
            inside = (rows >= 0) & (rows < world.height) & (columns >= 0) & (columns < world.width) & (t <= limit)
            open_beams, rows, columns = open_beams[inside], rows[inside], columns[inside]
            free = distances[rows, columns] / world.resolution
            struck = world.obstacles[rows, columns]
            hit[open_beams[struck]] = True
            # The distance of a cell holds for its centre: a beam may safely go less than that by a diagonal.
            travelled[open_beams] += numpy.maximum(free - 0.71, 0.25)
            open_beams = open_beams[~struck]
        ranges = numpy.where(hit, travelled * world.resolution, math.inf)
        noisy = ranges + self._random.normal(0.0, model.noise, model.beams)
        ranges = numpy.where((noisy >= model.range_min) & (noisy <= model.range_max), noisy, math.inf)
        return ranges.astype(numpy.float32)


def _grid_position(world: OccupancyMap, pose: Pose) -> tuple[float, float]:
    dx, dy = pose.x - world.origin.x, pose.y - world.origin.y
    cos, sin = math.cos(world.origin.yaw), math.sin(world.origin.yaw)
    return (dy * cos - dx * sin) / world.resolution, (dx * cos + dy * sin) / world.resolution
