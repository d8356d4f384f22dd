# SPDX-License-Identifier: BSD-3-Clause
"""Rooms and walls that are drawn in a world file, as an occupancy map."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import ClassVar, Final

import numpy
from numpy.typing import NDArray

from flexbt_sim.world.plane import FREE, MAX_CELLS, OCCUPIED, OccupancyMap, Point, Pose

from .specification import Specification, key

MAX_PARTS: Final = 5000
PIECE: Final = 32
"""Cells across which a piece of a wall goes at most along the axis along which it is shorter."""


@dataclass(frozen=True)
class Opening(Specification):
    """A gap in the walls."""

    title: ClassVar[str] = 'opening'

    at: Point = key('its middle: [x, y]', unit='m')
    width: float = key('how wide it is', 1.0, unit='m', low=0.05, high=100.0)


@dataclass(frozen=True)
class Room(Specification):
    """A room: four walls round a rectangle, whose middle line they follow."""

    title: ClassVar[str] = 'room'

    from_: Point = key('a corner: [x, y]', unit='m')
    to: Point = key('the opposite corner: [x, y]', unit='m')

    @property
    def walls(self) -> tuple[Point, ...]:
        """Its walls as one line."""
        (x0, y0), (x1, y1) = self.from_, self.to
        return (x0, y0), (x1, y0), (x1, y1), (x0, y1), (x0, y0)


@dataclass(frozen=True)
class FloorPlan(Specification):
    """Rooms, walls and openings. Openings are cut into walls when these are drawn; the order does not matter."""

    title: ClassVar[str] = 'plan'

    rooms: tuple[Room, ...] = key('the rooms; neighbours share a wall where their corners say so', ())
    walls: tuple[tuple[Point, ...], ...] = key(
        'more walls, each a line along points: [[x, y], [x, y], ...]', (), unit='m'
    )
    openings: tuple[Opening, ...] = key('gaps in the walls, for doors and passages', ())
    thickness: float = key('thickness of the walls', 0.1, unit='m', low=0.01, high=10.0)
    resolution: float = key('side of a cell of the map that it becomes', 0.05, unit='m', low=0.005, high=10.0)
    margin: float = key('free space round it on the map', 0.5, unit='m', low=0.0, high=100.0)

    def conflicts(self) -> Iterable[str]:
        parts = len(self.rooms) + len(self.openings) + sum(map(len, self.walls))
        if not 0 < parts <= MAX_PARTS or not (self.rooms or self.walls):
            yield f'give rooms or walls, {MAX_PARTS} parts at most'
            return
        if any(len(wall) < 2 for wall in self.walls):
            yield 'a wall has two points or more'
        rows, columns, _ = self._grid()
        if rows * columns > MAX_CELLS:
            yield f'{rows} x {columns} cells; a map has at most {MAX_CELLS}: a coarser resolution needs fewer'

    def _lines(self) -> list[tuple[Point, ...]]:
        return [*(room.walls for room in self.rooms), *self.walls]

    def _grid(self) -> tuple[int, int, Point]:
        points = [point for line in self._lines() for point in line]
        border = self.margin + self.thickness / 2.0
        left, bottom = min(x for x, _ in points) - border, min(y for _, y in points) - border
        width, height = max(x for x, _ in points) + border - left, max(y for _, y in points) + border - bottom
        return math.ceil(height / self.resolution - 1e-6), math.ceil(width / self.resolution - 1e-6), (left, bottom)

    def drawn(self) -> OccupancyMap:
        """The map: cells whose middle is in a wall, and in no opening, are occupied."""
        rows, columns, (left, bottom) = self._grid()
        cells = numpy.full((rows, columns), FREE, numpy.int8)
        half = self.thickness / 2.0 + 1e-9
        for line in self._lines():
            for start, end in pairwise(line):
                # In pieces, for of all cells round a long wall that is aslant few are in it.
                narrow = min(abs(a - b) for a, b in zip(start, end, strict=True)) / self.resolution
                ends = numpy.linspace(start, end, max(1, math.ceil(narrow / PIECE)) + 1)
                for piece in pairwise(ends.tolist()):
                    self._fill(cells, (left, bottom), (start, end), piece, half)
        for opening in self.openings:
            x, y = opening.at
            reach = opening.width / 2.0
            r0, r1 = (max(0, math.ceil((v - bottom) / self.resolution - 0.5 - 1e-6)) for v in (y - reach, y + reach))
            c0, c1 = (max(0, math.ceil((v - left) / self.resolution - 0.5 - 1e-6)) for v in (x - reach, x + reach))
            cells[r0:r1, c0:c1] = FREE
        return OccupancyMap(cells, self.resolution, Pose(left, bottom, 0.0))

    def _fill(
        self, cells: NDArray[numpy.int8], corner: Point, wall: tuple[Point, Point], piece: Sequence[Point], half: float
    ) -> None:  # fmt: skip
        """Draw a piece of a straight wall: all cells round it whose middle is within half the thickness of the wall of
        its middle line."""
        start, end = wall
        ends = list(zip(*piece, corner, strict=True))
        left, bottom = (max(0, math.floor((min(a, b) - half - c) / self.resolution)) for a, b, c in ends)
        right, top = (math.ceil((max(a, b) + half - c) / self.resolution) for a, b, c in ends)
        part = cells[bottom : top + 1, left : right + 1]
        x = corner[0] + (left + numpy.arange(part.shape[1]) + 0.5) * self.resolution - start[0]
        y = corner[1] + (bottom + numpy.arange(part.shape[0])[:, None] + 0.5) * self.resolution - start[1]
        dx, dy = end[0] - start[0], end[1] - start[1]
        square = dx * dx + dy * dy
        along = numpy.clip((x * dx + y * dy) / square, 0.0, 1.0) if square else numpy.zeros_like(x + y)
        away = numpy.maximum(numpy.abs(x - along * dx), numpy.abs(y - along * dy))
        part[away <= half] = OCCUPIED
