# SPDX-License-Identifier: BSD-3-Clause
"""Costmaps with the layers of Nav2: the static map, obstacles that a lidar sees, and inflation."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy
from numpy.typing import NDArray

from flexbt_sim.world.devices import LidarModel
from flexbt_sim.world.plane.geometry import Pose
from flexbt_sim.world.plane.occupancy_map import OccupancyMap

from .costmap import CellBox, Costmap, Inflation
from .kernels import Bools, trace

KNOWN_TOLERANCE: Final = 0.05
"""Least distance, m, within which the end of a beam counts as that of an obstacle of the static map. Nav2 marks such
points; they would make each passage a cell narrower on both sides."""

MOST_TOLERANCE: Final = 0.5
"""Maximum of this distance, m: a robot has to see what stands before a wall."""

DEVIATIONS: Final = 5.0
"""This distance in standard deviations of the noise of the lidar. With three, one beam in 700 would mark a cell in
front of a wall, and robots brake for obstacles that appear near them."""

LOCAL_SIZE: Final = 3.0
ROUND_ROBOT: Final = 1.0
"""Width of the local costmap, m, and how much of it is on each side of a large robot at least; there is as much as the
robot reaches, since a larger one is faster."""

MARK_RANGE: Final = 2.5
CLEAR_BEYOND: Final = 0.5
"""Minimum range from the lidar within which obstacles are marked, and additional range within which free space is
cleared, m: Nav2's obstacle_max_range, and the excess of its raytrace_max_range."""


def local_size(inflation: Inflation) -> float:
    """Width of the local costmap of a robot, m."""
    outer = inflation.outer_radius
    return max(LOCAL_SIZE, 2.0 * (outer + max(ROUND_ROBOT, outer)))


def known_tolerance(lidar: LidarModel | None) -> float:
    """Return the tolerance of a :class:`LayeredCostmap`, m, for what a robot has as its lidar."""
    noise = 0.0 if lidar is None else lidar.noise
    return min(MOST_TOLERANCE, max(KNOWN_TOLERANCE, DEVIATIONS * noise))


def mark_range(inflation: Inflation) -> float:
    """Return how far from its lidar, which may be anywhere on it, a robot marks obstacles, m: all that is round it, as
    far as the local costmap reaches to each side. A car that backs up has its lidar in front.
    """
    return max(MARK_RANGE, local_size(inflation) / 2.0 + inflation.outer_radius)


@dataclass(frozen=True)
class Observation:
    """An observation of a lidar at one moment.

    ``sensor`` is the pose of the lidar in the frame of the map; ``angles``, rad, are those of the beams relative to its
    heading, ``ranges``, m, their lengths: infinite where nothing is within ``range_max``, -infinite or NaN where
    nothing is known (REP 117).
    """

    sensor: Pose
    angles: NDArray[numpy.float64]
    ranges: NDArray[numpy.float64]
    range_max: float = math.inf


class LayeredCostmap:
    """A costmap that is updated from scans. Only changed parts are recomputed.

    ``costmap`` is changed in place; another thread uses a copy of it.
    """

    def __init__(self, static: Costmap, window: float = math.inf, tolerance: float = KNOWN_TOLERANCE) -> None:
        """Make the layers. ``static`` is the map without anything seen. Obstacles outside a square round the robot,
        ``window`` m
        wide, are forgotten: the rolling window of a local costmap. Since robots drive on that one, it is never without
        what was seen last, which is marked again at once when it is cleared. Within ``tolerance`` m of an obstacle of
        the map nothing is marked.
        """
        self.costmap = static.copy()
        self._static: Bools = static.obstacles
        self._marks: Bools = numpy.zeros_like(static.obstacles)
        self._mark = mark_range(static.inflation)
        self._clear = self._mark + CLEAR_BEYOND
        self._window_size = window
        self._tolerance = tolerance
        self._window = CellBox(0, 0, 0, 0)
        self._newest: tuple[Observation, Pose] | None = None
        self.changes = 0

    def observe(self, observation: Observation, robot: Pose) -> None:
        """Add an observation of a lidar. Cells under the robot are never marked."""
        world = self.costmap.world
        self._newest = observation, robot
        old, self._window = self._window, self.window(robot)
        seen = _square(world, observation.sensor, 2.0 * self._clear)
        touched = _around(seen, old, self._window) if math.isfinite(self._window_size) else seen
        before = self._marks[touched.cells].copy()
        self._trace(observation)
        self._clear_disc(robot)
        if math.isfinite(self._window_size):
            kept = self._marks[self._window.cells].copy()
            self._marks[touched.cells] = False
            self._marks[self._window.cells] = kept
        self._take_over(touched, before)

    def continue_from(self, before: LayeredCostmap) -> None:
        """Add what ``before``, a costmap on another map, has seen; on another grid, only its last observation."""
        world, other = self.costmap.world, before.costmap.world
        if (world.cells.shape, world.resolution, world.origin) == (other.cells.shape, other.resolution, other.origin):
            nothing, self._marks, self._window = self._marks, before._marks.copy(), before._window
            self._take_over(CellBox(0, world.height, 0, world.width), nothing)
        if before._newest is not None:
            self.observe(*before._newest)

    def window(self, robot: Pose) -> CellBox:
        """Return the part of the grid around the robot in which obstacles are kept."""
        world = self.costmap.world
        if math.isinf(self._window_size):
            return CellBox(0, world.height, 0, world.width)
        return _square(world, robot, self._window_size)

    def clear(self) -> None:
        """Clear all observed obstacles: Nav2's clear_entirely. The static map stays."""
        height, width = self._marks.shape
        self._forget(numpy.ones(self._marks.shape, bool), CellBox(0, height, 0, width))

    def clear_square(self, centre: Pose, size: float) -> None:
        """Clear observed obstacles in a square, ``size`` m wide: Nav2's clear_around_robot and clear_around_pose."""
        box = _square(self.costmap.world, centre, size)
        self._forget(numpy.ones(self._marks[box.cells].shape, bool), box)

    def clear_except_square(self, centre: Pose, size: float) -> None:
        """Clear observed obstacles outside a square, ``size`` m wide: Nav2's clear_except_region."""
        outside = numpy.ones(self._marks.shape, bool)
        outside[_square(self.costmap.world, centre, size).cells] = False
        height, width = self._marks.shape
        self._forget(outside, CellBox(0, height, 0, width))

    def _forget(self, chosen: Bools, box: CellBox) -> None:
        before = self._marks[box.cells].copy()
        self._marks[box.cells] &= ~chosen
        self._take_over(box, before)
        if math.isfinite(self._window_size) and self._newest is not None:
            self.observe(*self._newest)

    def _trace(self, observation: Observation) -> None:
        world = self.costmap.world
        row, column = world.grid_position(observation.sensor.x, observation.sensor.y)
        angles = observation.angles + (observation.sensor.yaw - world.origin.yaw)
        ranges = numpy.where(numpy.isnan(observation.ranges), -1.0, observation.ranges)
        seen = numpy.minimum(ranges, min(self._clear, observation.range_max))
        seen[(ranges > self._mark) & (ranges <= self._clear)] = self._mark  # what is not marked there is not cleared
        cleared = numpy.where(ranges < 0.0, 0.0, seen) / world.resolution
        struck = numpy.where((ranges >= 0.0) & (ranges <= self._mark), ranges, -1.0) / world.resolution
        directions = numpy.stack([numpy.sin(angles), numpy.cos(angles)], axis=1)
        tolerance = self._tolerance / world.resolution
        trace(self._marks, self._static, row, column, directions, cleared, struck, tolerance)

    def _clear_disc(self, robot: Pose) -> None:
        """Nav2's footprint clearing, of cells that lie in the footprint as a whole: what touches the robot stays."""
        world, radius = self.costmap.world, self.costmap.inflation.robot_radius
        box = _square(world, robot, 2.0 * radius)
        row, column = world.grid_position(robot.x, robot.y)
        rows, columns = numpy.ogrid[box.cells]
        farthest = numpy.hypot(numpy.abs(rows + 0.5 - row) + 0.5, numpy.abs(columns + 0.5 - column) + 0.5)
        self._marks[box.cells] &= farthest * world.resolution > radius

    def _take_over(self, box: CellBox, before: Bools) -> None:
        """Note that the marks in a box were changed."""
        rows, columns = numpy.nonzero(self._marks[box.cells] != before)
        if not rows.size:
            return
        changed = CellBox(
            box.bottom + int(rows.min()),
            box.bottom + int(rows.max()) + 1,
            box.left + int(columns.min()),
            box.left + int(columns.max()) + 1,
        )
        self.costmap.obstacles[changed.cells] = self._static[changed.cells] | self._marks[changed.cells]
        self.costmap.refresh(changed)
        self.changes += 1


def _square(world: OccupancyMap, centre: Pose, size: float) -> CellBox:
    """Return the cells of a square, ``size`` m wide, that lies as the grid does; those that are on the map."""
    (row, column), half = world.grid_position(centre.x, centre.y), size / 2.0 / world.resolution
    bottom, top = (min(max(math.floor(at), 0), world.height) for at in (row - half, row + half + 1.0))
    left, right = (min(max(math.floor(at), 0), world.width) for at in (column - half, column + half + 1.0))
    return CellBox(bottom, top, left, right)


def _around(*boxes: CellBox) -> CellBox:
    """Return the smallest box that holds others; empty ones do not count."""
    filled: Sequence[CellBox] = [box for box in boxes if box.bottom < box.top and box.left < box.right]
    if not filled:
        return boxes[0]
    return CellBox(
        min(box.bottom for box in filled),
        max(box.top for box in filled),
        min(box.left for box in filled),
        max(box.right for box in filled),
    )
