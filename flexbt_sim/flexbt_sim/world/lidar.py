# SPDX-License-Identifier: BSD-3-Clause
"""A planar lidar, by marching along all beams at once over the cells and through the field of distances."""

from __future__ import annotations

import math
from typing import Final

import numpy
from numpy.typing import NDArray

from .descriptions import LidarModel
from .plane import OccupancyMap, Pose

_BEYOND: Final = 1e-6
"""By how much, in cells, a beam goes into the next cell to be in it."""


class Lidar:
    """Scans of a map. The noise depends on the seed and the number of the scan only."""

    def __init__(self, world: OccupancyMap, model: LidarModel, seed: int) -> None:
        self._world = world
        self.model = model
        self._random = numpy.random.default_rng(seed)
        self._angles = numpy.arange(model.beams) * model.angle_increment

    def scan(self, pose: Pose) -> NDArray[numpy.float32]:
        """Range of each beam, m; infinite where nothing is within range, and minus infinity where it is too near.

        So says REP 117 of ROS.
        """
        model = self.model
        angles = self._angles + (pose.yaw - self._world.origin.yaw)
        directions = numpy.stack([numpy.sin(angles), numpy.cos(angles)])  # in rows and columns
        directions[numpy.abs(directions) < 1e-12] = 1e-12
        ranges = self._march(numpy.array([self._world.grid_position(pose.x, pose.y)]).T, directions)
        ranges = ranges * self._world.resolution + self._random.normal(0.0, model.noise, model.beams)
        ranges[ranges > model.range_max] = math.inf
        ranges[ranges < model.range_min] = -math.inf
        return ranges.astype(numpy.float32)

    def _march(self, position: NDArray[numpy.float64], directions: NDArray[numpy.float64]) -> NDArray[numpy.float64]:
        """How far beams get from a position (2, 1) in directions (2, n), in cells; infinite where they hit nothing."""
        world = self._world
        size = numpy.array([[world.height], [world.width]])
        borders = numpy.stack([-position / directions, (size - position) / directions])
        travelled = numpy.maximum(borders.min(axis=0).max(axis=0), 0.0) + _BEYOND
        ends = numpy.minimum(borders.max(axis=0).min(axis=0), self.model.range_max / world.resolution) - _BEYOND
        ranges = numpy.full(travelled.shape, math.inf)
        beams = numpy.flatnonzero(travelled < ends)
        while beams.size:
            along = directions[:, beams]
            places = position + travelled[beams] * along
            cells = numpy.floor(places).astype(int)
            rows, columns = numpy.clip(cells, 0, size - 1)
            struck = world.obstacles[rows, columns]
            ranges[beams[struck]] = travelled[beams[struck]]
            # To the next cell; or as far as nothing is round the centre of this one, less half its diagonal.
            to_next = ((cells + (along > 0.0) - places) / along).min(axis=0) + _BEYOND
            travelled[beams] += numpy.maximum(to_next, world.distances[rows, columns] / world.resolution - 0.71)
            beams = beams[~struck & (travelled[beams] < ends[beams])]
        return ranges
