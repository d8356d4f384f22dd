# SPDX-License-Identifier: BSD-3-Clause
"""Maps of many kinds, another one for each seed: what robots are to find their way in."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

import numpy
from numpy.typing import NDArray
from scipy.ndimage import uniform_filter

from flexbt_sim.world import DoorModel, OccupancyMap, Pose

Cells = NDArray[numpy.int8]
Line = tuple[tuple[float, float], tuple[float, float]]
"""From a place (row, column) to another one."""

Random = numpy.random.Generator
THICK: Final = 0.15
"""Of walls, m."""


def rooms(cells: Cells, resolution: float, random: Random) -> list[Line]:
    """Rooms with walls of 0.15 m and doors of 0.9 to 1.2 m, each reached from another one."""
    thick = round(THICK / resolution)
    gaps: list[Line] = []

    def divide(bottom: int, top: int, left: int, right: int) -> None:
        height, width = top - bottom, right - left
        if max(height, width) * resolution < 7.0:
            return
        door = round(random.uniform(0.9, 1.2) / resolution)
        share = random.uniform(0.35, 0.65)
        if height > width:
            at = bottom + round(share * height)
            cells[at : at + thick, left:right] = 100
            begin = int(random.integers(left + 4, right - door - 4))
            cells[at : at + thick, begin : begin + door] = 0
            gaps.append(((at + thick / 2.0, begin), (at + thick / 2.0, begin + door)))
            divide(bottom, at, left, right)
            divide(at + thick, top, left, right)
        else:
            at = left + round(share * width)
            cells[bottom:top, at : at + thick] = 100
            begin = int(random.integers(bottom + 4, top - door - 4))
            cells[begin : begin + door, at : at + thick] = 0
            gaps.append(((begin, at + thick / 2.0), (begin + door, at + thick / 2.0)))
            divide(bottom, top, left, at)
            divide(bottom, top, at + thick, right)

    divide(0, cells.shape[0], 0, cells.shape[1])
    return gaps


def warehouse(cells: Cells, resolution: float, random: Random) -> list[Line]:
    """Shelves with aisles, and pallets in these."""
    for row in range(80, cells.shape[0] - 60, 90):
        for column in range(60, cells.shape[1] - 150, 200):
            cells[row : row + 30, column : column + 150] = 100
    return blocks(cells, resolution, random, 60, 0.8)


def clutter(cells: Cells, resolution: float, random: Random) -> list[Line]:
    """Blocks of all sizes anywhere."""
    return blocks(cells, resolution, random, round(cells.size * resolution**2 / 12.0), 2.5)


def yard(cells: Cells, resolution: float, random: Random) -> list[Line]:
    """Draw buildings and what is left between them, for cars."""
    return blocks(cells, resolution, random, round(cells.size * resolution**2 / 120.0), 6.0)


def blocks(cells: Cells, resolution: float, random: Random, count: int, size: float) -> list[Line]:
    """Rectangles of sides of up to ``size`` m."""
    for row, column in random.integers(0, cells.shape, (count, 2)).tolist():
        height, width = random.integers(2, round(size / resolution), 2).tolist()
        cells[row : row + height, column : column + width] = 100
    return []


def maze(cells: Cells, resolution: float, random: Random) -> list[Line]:
    """Corridors of 1.3 m with one way from each place to each other, and a few walls torn down."""
    pitch, thick = round(1.45 / resolution), round(THICK / resolution)
    height, width = cells.shape[0] // pitch, cells.shape[1] // pitch
    cells[:] = 100

    def open_up(first: tuple[int, int], last: tuple[int, int]) -> None:
        (bottom, left), (top, right) = sorted((first, last))
        cells[bottom * pitch + thick : (top + 1) * pitch, left * pitch + thick : (right + 1) * pitch] = 0

    way, seen = [(0, 0)], {(0, 0)}
    while way:
        row, column = way[-1]
        near = [(row + 1, column), (row - 1, column), (row, column + 1), (row, column - 1)]
        ahead = [at for at in near if at not in seen and 0 <= at[0] < height and 0 <= at[1] < width]
        if not ahead:
            way.pop()
            continue
        way.append(ahead[random.integers(len(ahead))])
        seen.add(way[-1])
        open_up((row, column), way[-1])
    for row, column in random.integers(0, (height - 1, width - 1), (height * width // 20, 2)).tolist():
        open_up((row, column), (row + 1, column))
    return []


def cave(cells: Cells, resolution: float, random: Random) -> list[Line]:
    """Halls and passages of any width between rough walls: smoothed noise."""
    coarse = random.random((cells.shape[0] // 4 + 1, cells.shape[1] // 4 + 1))
    for size in (round(1.2 / resolution / 4.0), round(0.8 / resolution / 4.0)):
        coarse = uniform_filter(coarse, size, mode='reflect')
    solid = coarse > numpy.quantile(coarse, 0.68)
    cells[:] = 100 * numpy.kron(solid, numpy.ones((4, 4), numpy.int8))[: cells.shape[0], : cells.shape[1]]
    return []


MAPS: Final[dict[str, tuple[Callable[[Cells, float, Random], list[Line]], tuple[int, int], float]]] = {
    'rooms': (rooms, (400, 400), 0.05),
    'warehouse': (warehouse, (1674, 1006), 0.03),
    'clutter': (clutter, (2000, 2000), 0.05),
    'maze': (maze, (500, 700), 0.05),
    'cave': (cave, (1200, 900), 0.04),
    'yard': (yard, (900, 1200), 0.1),
}


def drawn(name: str, seed: int) -> tuple[OccupancyMap, list[DoorModel]]:
    """Return a map, with a closed room in its corner, that seeds tell apart; and automatic doors, if it has
    doorways."""
    draw, shape, resolution = MAPS[name]
    cells = numpy.zeros(shape, numpy.int8)
    gaps = draw(cells, resolution, numpy.random.default_rng(seed))
    cells[:60, :60] = 0
    cells[58:60, :60] = cells[:60, 58:60] = 100
    cells[:2] = cells[-2:] = cells[:, :2] = cells[:, -2:] = 100
    world = OccupancyMap(cells, resolution, Pose(-5.0, -3.0, 0.0))
    ends = [(world.point(*(at - 0.5 for at in one)), world.point(*(at - 0.5 for at in other))) for one, other in gaps]
    return world, [DoorModel(from_=one, to=other, automatic=True) for one, other in ends]
