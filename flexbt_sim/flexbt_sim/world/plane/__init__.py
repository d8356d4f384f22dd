# SPDX-License-Identifier: BSD-3-Clause
"""The plane: maps, shapes, bodies on them, how far they are apart, and how far beams get."""

from . import loops
from .acceleration import compiled
from .blocks import Blocks
from .bodies import Body, Normals, Surroundings, generator
from .geometry import FARTHEST, Pose, compose, drive, inverse, wrap
from .occupancy_map import (
    FAR,
    FREE,
    MAX_CELLS,
    MAX_RESOLUTION,
    MIN_RESOLUTION,
    OCCUPIED,
    UNKNOWN,
    OccupancyMap,
    load_map,
)
from .ray_casting import RayCaster, Sensor, outlines
from .shapes import MAX_CORNERS, Circle, Point, Polygon, Shape, box, contains, gap
from .space import Space, check_pose, polygon_gap

__all__ = [
    'FAR',
    'FARTHEST',
    'FREE',
    'MAX_CELLS',
    'MAX_CORNERS',
    'MAX_RESOLUTION',
    'MIN_RESOLUTION',
    'OCCUPIED',
    'UNKNOWN',
    'Blocks',
    'Body',
    'Circle',
    'Normals',
    'OccupancyMap',
    'Point',
    'Polygon',
    'Pose',
    'RayCaster',
    'Sensor',
    'Shape',
    'Space',
    'Surroundings',
    'box',
    'check_pose',
    'compiled',
    'compose',
    'contains',
    'drive',
    'gap',
    'generator',
    'inverse',
    'load_map',
    'loops',
    'outlines',
    'polygon_gap',
    'wrap',
]
