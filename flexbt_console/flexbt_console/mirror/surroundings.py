# SPDX-License-Identifier: BSD-3-Clause
"""What is around the robot, as far as its operator sees it: the map, the plan, and what the lidar meets."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import compress, pairwise
from typing import Final

OCCUPIED: Final = 65
"""Percent from which on a cell of a map is occupied (nav_msgs/OccupancyGrid, map_server)."""

_IS_OCCUPIED: Final = bytes(OCCUPIED <= cell <= 100 for cell in range(256))

Points = tuple[tuple[float, float], ...]
"""Points in the frame of the map, m."""


@dataclass(frozen=True, slots=True)
class GridMap:
    """A map (nav_msgs/OccupancyGrid): ``cells`` row by row from ``x``, ``y`` (m) on, a byte each; 255 is unknown."""

    width: int
    height: int
    resolution: float
    x: float
    y: float
    cells: bytes

    def occupied_columns(self, row: int) -> Iterator[int]:
        """Return the columns of the occupied cells of a row, which has none outside the map."""
        first = row * self.width
        cells = self.cells[first : first + self.width] if 0 <= row < self.height else b''
        return compress(range(self.width), cells.translate(_IS_OCCUPIED))

    @property
    def size(self) -> tuple[float, float]:
        """Width and height, m."""
        return self.width * self.resolution, self.height * self.resolution


@dataclass(frozen=True, slots=True)
class Surroundings:
    """The newest of each, in the frame of the map; ``None`` or empty while it is not known.

    ``scan`` is what the lidar meets; ``at`` the goal where it is known by itself.
    """

    map: GridMap | None = None
    plan: Points = ()
    driven: Points = ()
    scan: Points = ()
    at: tuple[float, float] | None = None

    @property
    def goal(self) -> tuple[float, float] | None:
        """The goal, or else the end of the plan."""
        return self.at or (self.plan[-1] if self.plan else None)

    @property
    def plan_length(self) -> float:
        """Length of the plan, m."""
        return sum(math.dist(a, b) for a, b in pairwise(self.plan))
