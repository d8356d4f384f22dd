# SPDX-License-Identifier: BSD-3-Clause
"""A grid of costs over a map, and inflation."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Final

import numpy
import scipy
from numpy.typing import NDArray

from flexbt_sim.errors import SimulationError
from flexbt_sim.world.plane.geometry import Circle, Pose, Shape, gap
from flexbt_sim.world.plane.loops import nearest
from flexbt_sim.world.plane.occupancy_map import OccupancyMap

from . import kernels
from .kernels import Bools, Costs, Squares

LETHAL: Final = 254
INSCRIBED: Final = 253
_HIGHEST_INFLATED: Final = 252.0


@dataclass(frozen=True)
class Inflation:
    """The decay of costs around obstacles.

    ``robot_radius`` in m: within it of an obstacle the robot's centre is in collision. ``radius`` in m: how far costs
    reach; ``scaling`` in 1/m: how fast they fall off, as exp(-scaling * distance beyond the robot's radius).
    ``corners`` are those of a robot that is not a circle, m from its centre; then its radius is the inscribed one.
    """

    robot_radius: float = 0.22
    radius: float = 0.70
    scaling: float = 3.0
    corners: tuple[tuple[float, float], ...] = ()

    @classmethod
    def of(cls, footprint: Shape, radius: float = 0.70, scaling: float = 3.0) -> Inflation:
        """Return the inflation for the footprint of a robot.

        Raises:
            SimulationError: its centre is not inside of it.
        """
        if isinstance(footprint, Circle):
            return cls(footprint.radius, radius, scaling)
        here, point = Pose(0.0, 0.0, 0.0), Circle(0.001)
        inscribed = -gap(footprint, here, point, here) - point.radius
        if inscribed <= 0.0:
            raise SimulationError('the footprint of the robot has to be round its centre: its frame is outside of it')
        return cls(inscribed, radius, scaling, footprint.corners)

    @cached_property
    def outer_radius(self) -> float:
        """Radius of the circle around the centre that contains all of the robot, m."""
        return max((math.hypot(x, y) for x, y in self.corners), default=self.robot_radius)


Position = tuple[float, float]
"""Row and column of a point, in cells; see :meth:`OccupancyMap.grid_position`."""


@dataclass(frozen=True)
class CellBox:
    """A part of a grid: rows from ``bottom`` to before ``top``, columns from ``left`` to before ``right``."""

    bottom: int
    top: int
    left: int
    right: int

    @property
    def cells(self) -> tuple[slice, slice]:
        """Index of the box in an array."""
        return slice(self.bottom, self.top), slice(self.left, self.right)

    def grown(self, by: int, shape: Sequence[int]) -> CellBox:
        """Return the box with this many more cells on each side, within a grid."""
        return CellBox(
            max(0, self.bottom - by),
            min(shape[0], self.top + by),
            max(0, self.left - by),
            min(shape[1], self.right + by),
        )


class Costmap:
    """Cost of each cell for the centre of the robot: 0 to 252, 253 in collision, 254 obstacle. Unknown is free.

    ``world`` has the geometry of the grid; ``obstacles`` are those of the world, unless others are given; ``squares``
    are the squared gaps of the cells, see :mod:`.kernels`.
    """

    def __init__(self, world: OccupancyMap, inflation: Inflation, obstacles: Bools | None = None) -> None:
        self.world = world
        self.inflation = inflation
        self.obstacles: Bools = world.obstacles if obstacles is None else obstacles
        reach = math.ceil(max(inflation.radius, inflation.outer_radius) / world.resolution) + 1
        self._reach = min(reach, max(self.obstacles.shape))
        self.squares, self.costs = self._inflated(CellBox(0, world.height, 0, world.width))

    def copy(self) -> Costmap:
        """Return a copy, for another thread or for separate obstacles."""
        other = object.__new__(Costmap)
        other.world, other.inflation, other._reach = self.world, self.inflation, self._reach
        other.obstacles, other.squares, other.costs = self.obstacles.copy(), self.squares.copy(), self.costs.copy()
        return other

    def refresh(self, box: CellBox) -> None:
        """Recompute the costs near a box in which ``obstacles`` were changed."""
        near = box.grown(self._reach, self.obstacles.shape)
        self.squares[near.cells], self.costs[near.cells] = self._inflated(near)
        self.__dict__.pop('regions', None)

    def _inflated(self, box: CellBox) -> tuple[Squares, Costs]:
        """Squared gaps, see :mod:`.kernels`, and costs in a box."""
        inflation = self.inflation
        squares: Squares = kernels.squared_gaps(self.obstacles, box.bottom, box.top, box.left, box.right, self._reach)
        distances = numpy.sqrt(squares, dtype=numpy.float32)
        distances *= self.world.resolution / 2.0
        distances[squares > 4 * self._reach**2] = math.inf
        in_collision, beyond = distances <= inflation.robot_radius, distances > inflation.radius
        distances -= inflation.robot_radius
        distances *= -inflation.scaling
        numpy.exp(distances, out=distances)
        distances *= _HIGHEST_INFLATED
        distances[beyond] = 0.0
        distances[in_collision] = INSCRIBED
        distances[squares == 0] = LETHAL
        return squares, distances.astype(numpy.uint8)

    @cached_property
    def regions(self) -> NDArray[numpy.int32]:
        """Region number of each cell: equal for cells connected for the robot, 0 where the robot cannot be."""
        labels: NDArray[numpy.int32] = scipy.ndimage.label(self.costs < INSCRIBED)[0]
        return labels

    def in_collision(self, pose: Pose) -> bool:
        """Return whether the robot would overlap an obstacle at a pose, or its centre be outside the map."""
        return not self.world.contains(*self.world.cell(pose.x, pose.y)) or self.overlap(pose) > 0.0

    def overlap(self, pose: Pose) -> float:
        """Return how much the robot would overlap obstacles there: 0 if it does not; otherwise the depth, m, to compare
        with.

        For a circle exactly. For a polygon it is the depth of its inscribed circle, that of the cell deepest in it, and
        the area of the cells that it touches, square m; some that it misses by up to a fifth of a cell count, too.
        """
        radius = self.inflation.robot_radius
        if self.is_free(pose.x, pose.y, self.inflation.outer_radius):
            return 0.0
        depth = max(0.0, radius - self.clearance(pose.x, pose.y, radius))
        if not self.inflation.corners:
            return depth
        depths = self._depths(pose)
        return depth + float(depths.max(initial=0.0)) + len(depths) * self.world.resolution**2

    def _depths(self, pose: Pose, on_map: bool | None = None) -> NDArray[numpy.float64]:
        """Return how deep, m, the obstacle cells are that the polygon touches; of those that are ``on_map``, or are
        not."""
        depths = self.world.resolution * math.sqrt(0.5) - self._outline_gaps(pose, self.inflation.outer_radius, on_map)
        return depths[depths > 0.0]

    def gap_seen(self, pose: Pose, within: float) -> float:
        """Distance, m, from the robot to the nearest obstacle that was seen and is not on the map: it may move.

        Negative where they overlap, infinite where none is nearer than ``within``. For a circle exactly, for a polygon
        up to a fifth of a cell too small.
        """
        inflation = self.inflation
        if inflation.corners:
            gaps = self._outline_gaps(pose, inflation.outer_radius + within, on_map=False)
            least = float(gaps.min(initial=math.inf)) - self.world.resolution * math.sqrt(0.5)
        else:
            radius = inflation.robot_radius
            least = self._distance(pose.x, pose.y, radius + within, on_map=False) - radius
        return least if least < within else math.inf

    def _outline_gaps(self, pose: Pose, reach: float, on_map: bool | None = None) -> NDArray[numpy.float64]:
        """Distances, m, from the polygon to the centres of obstacle cells, negative inside; of all that are no farther
        than ``reach`` from the robot, and more.
        """
        world = self.world
        row, column = world.grid_position(pose.x, pose.y)
        rows, columns = self._cells_near(row, column, reach / world.resolution + 1.0, on_map)
        # The centres of the cells as the robot sees them, m.
        turn = complex(0.0, world.origin.yaw - pose.yaw)
        offset = (columns + (0.5 - column)) + 1j * (rows + (0.5 - row))
        cells = offset * (world.resolution * numpy.exp(turn))
        corners = numpy.array([complex(x, y) for x, y in self.inflation.corners])
        gaps, inside = numpy.full(len(cells), math.inf), numpy.zeros(len(cells), bool)
        for a, b in zip(corners, numpy.roll(corners, -1), strict=True):
            share = numpy.clip(((cells - a) * (b - a).conjugate()).real / abs(b - a) ** 2, 0.0, 1.0)
            gaps = numpy.minimum(gaps, numpy.abs(cells - a - share * (b - a)))
            if a.imag != b.imag:
                crossing = a.real + (cells.imag - a.imag) / (b.imag - a.imag) * (b.real - a.real)
                inside ^= ((a.imag > cells.imag) != (b.imag > cells.imag)) & (cells.real < crossing)
        return numpy.where(inside, -gaps, gaps)

    def is_free(self, x: float, y: float, radius: float) -> bool:
        """Return whether a circle of a radius, m, round a point overlaps no obstacle; on the map exactly."""
        world = self.world
        row, column = world.grid_position(x, y)
        r, c = (min(max(math.floor(at), 0), size - 1) for at, size in zip((row, column), self.costs.shape, strict=True))
        known = math.sqrt(self.squares[r, c]) / 2.0 - math.hypot(row - r - 0.5, column - c - 0.5)
        return known * world.resolution >= radius or self.clearance(x, y, radius) >= radius

    def has_room(self, pose: Pose, radius: float) -> bool:
        """Return whether a circle of a radius, m, round a pose is on the map as a whole, and overlaps no obstacle."""
        world, cells = self.world, radius / self.world.resolution
        row, column = world.grid_position(pose.x, pose.y)
        is_on_map = cells <= row <= world.height - cells and cells <= column <= world.width - cells
        return is_on_map and self.is_free(pose.x, pose.y, radius)

    def clearance(self, x: float, y: float, within: float) -> float:
        """Distance from a point to the nearest obstacle, m, exactly; infinite where none is nearer than ``within``."""
        return self._distance(x, y, within)

    def touches_map(self, pose: Pose) -> bool:
        """Return whether the robot would overlap an obstacle of the static map there, whatever else was seen."""
        radius = self.inflation.robot_radius
        if self._distance(pose.x, pose.y, radius, on_map=True) < radius:
            return True
        return bool(self.inflation.corners) and len(self._depths(pose, on_map=True)) > 0

    def _distance(self, x: float, y: float, within: float, on_map: bool | None = None) -> float:
        world = self.world
        obstacles = world.obstacles if on_map else self.obstacles
        reach = within / world.resolution + 1.0
        least = nearest(obstacles, world.obstacles, on_map is False, *world.grid_position(x, y), reach)
        distance = float(least) * world.resolution
        return distance if distance < within else math.inf

    def _cells_near(
        self, row: float, column: float, reach: float, on_map: bool | None
    ) -> tuple[NDArray[numpy.int64], NDArray[numpy.int64]]:
        """Rows and columns of the obstacles in a square; of those that are ``on_map``, or are not."""
        bottom, left = max(0, math.floor(row - reach)), max(0, math.floor(column - reach))
        part = (slice(bottom, max(0, math.ceil(row + reach))), slice(left, max(0, math.ceil(column + reach))))
        near = self.world.obstacles[part] if on_map else self.obstacles[part]
        if on_map is False:
            near = near & ~self.world.obstacles[part]
        rows, columns = numpy.nonzero(near)
        return rows + bottom, columns + left

    def known_distance(self, x: float, y: float) -> float:
        """Distance from the cell of a point to the nearest obstacle, m; infinite beyond the reach of the inflation."""
        cell = self.world.cell(x, y)
        if not self.world.contains(*cell) or self.squares[cell] > 4 * self._reach**2:
            return math.inf
        return math.sqrt(self.squares[cell]) * self.world.resolution / 2.0

    def is_clear(self, start: Position, end: Position, radius: float) -> bool:
        """Return whether a circle, of a radius in m, can move straight from one position to the other.

        Never wrongly true; wrongly false at most where it has less than a cell to spare.
        """
        return bool(kernels.is_clear(self.obstacles, self.squares, start, end, radius / self.world.resolution))

    def mean_cost(self, start: Position, end: Position) -> float:
        """Mean cost of the cells along a straight line between two positions on the map."""
        return float(kernels.mean_cost(self.costs, start, end))
