# SPDX-License-Identifier: BSD-3-Clause
"""Maps for tests: drawn from text, or at random from a seed."""

from __future__ import annotations

import math
import random

import numpy

from flexbt_sim.geometry import Pose
from flexbt_sim.occupancy_map import FREE, OCCUPIED, UNKNOWN, OccupancyMap

RESOLUTION = 0.05


def drawn(*rows: str, resolution: float = RESOLUTION, origin: Pose = Pose(0.0, 0.0, 0.0)) -> OccupancyMap:  # noqa: B008 - immutable
    """A map from rows of text, the uppermost first: ``#`` occupied, ``?`` unknown, anything else free."""
    values = {'#': OCCUPIED, '?': UNKNOWN}
    cells = numpy.array([[values.get(mark, FREE) for mark in row] for row in reversed(rows)], numpy.int8)
    return OccupancyMap(cells, resolution, origin)


def cluttered(seed: int, *, size: int = 80, blocks: int = 14, border: bool = True) -> OccupancyMap:
    """A square map with rectangular blocks at random, closed by a border, and turned and shifted at random."""
    chance = random.Random(seed)
    cells = numpy.zeros((size, size), numpy.int8)
    if border:
        cells[0, :] = cells[-1, :] = cells[:, 0] = cells[:, -1] = OCCUPIED
    for _ in range(blocks):
        row, column = chance.randrange(size), chance.randrange(size)
        cells[row : row + chance.randint(1, 9), column : column + chance.randint(1, 9)] = OCCUPIED
    origin = Pose(chance.uniform(-5, 5), chance.uniform(-5, 5), chance.uniform(-math.pi, math.pi))
    return OccupancyMap(cells, RESOLUTION, origin)


def free_pose(world: OccupancyMap, chance: random.Random, clearance: float) -> Pose | None:
    """A pose at random with so much room round it; None when there is none."""
    rows, columns = numpy.nonzero(world.distances > clearance)
    if not rows.size:
        return None
    index = chance.randrange(rows.size)
    return Pose(*world.point(float(rows[index]), float(columns[index])), chance.uniform(-math.pi, math.pi))
