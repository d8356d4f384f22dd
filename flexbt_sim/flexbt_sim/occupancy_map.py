# SPDX-License-Identifier: BSD-3-Clause
"""Maps as ROS's map_server reads them: a YAML file that names an image."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, Final

import numpy
import yaml
from numpy.typing import NDArray
from PIL import Image
from scipy import ndimage

from flexbt_sim.errors import MapError
from flexbt_sim.geometry import Pose

FREE: Final = 0
OCCUPIED: Final = 100
UNKNOWN: Final = -1
MODES: Final = ('trinary', 'scale', 'raw')

MAX_YAML_BYTES: Final = 100_000
MAX_CELLS: Final = 25_000_000
"""Largest map, cells: what costmaps of it need still fits a laptop."""

Occupancy = NDArray[numpy.int8]
Distances = NDArray[numpy.float32]


@dataclass(frozen=True)
class OccupancyMap:
    """A grid of occupancies: -1 unknown, otherwise 0 free to 100 occupied.

    ``cells[row, column]``; row 0 is at the bottom, as in nav_msgs/OccupancyGrid. ``resolution`` is m per cell,
    ``origin`` the pose of the lower left corner of cell (0, 0).
    """

    cells: Occupancy
    resolution: float
    origin: Pose

    @property
    def height(self) -> int:
        """Rows."""
        return int(self.cells.shape[0])

    @property
    def width(self) -> int:
        """Columns."""
        return int(self.cells.shape[1])

    @cached_property
    def obstacles(self) -> NDArray[numpy.bool_]:
        """Which cells are obstacles: occupied more likely than not. The border outside of the map counts as free."""
        obstacles: NDArray[numpy.bool_] = self.cells > OCCUPIED // 2
        return obstacles

    @cached_property
    def distances(self) -> Distances:
        """For each cell, the distance from its centre to the nearest point of an obstacle cell, m; 0 in an obstacle."""
        if not self.obstacles.any():
            return numpy.full(self.cells.shape, math.inf, numpy.float32)
        to_centre = ndimage.distance_transform_edt(~self.obstacles) * self.resolution
        distances: Distances = numpy.maximum(to_centre - self.resolution / 2.0, 0.0).astype(numpy.float32)
        return distances

    def cell(self, x: float, y: float) -> tuple[int, int]:
        """Row and column of a point of the map frame; they may lie outside of the grid."""
        dx, dy = x - self.origin.x, y - self.origin.y
        cos, sin = math.cos(self.origin.yaw), math.sin(self.origin.yaw)
        return (
            math.floor((dy * cos - dx * sin) / self.resolution),
            math.floor((dx * cos + dy * sin) / self.resolution),
        )

    def point(self, row: float, column: float) -> tuple[float, float]:
        """Centre of a cell, in the map frame."""
        u, v = (column + 0.5) * self.resolution, (row + 0.5) * self.resolution
        cos, sin = math.cos(self.origin.yaw), math.sin(self.origin.yaw)
        return self.origin.x + u * cos - v * sin, self.origin.y + u * sin + v * cos

    def contains(self, row: int, column: int) -> bool:
        """Whether a cell is part of the grid."""
        return 0 <= row < self.height and 0 <= column < self.width

    def clearance(self, x: float, y: float) -> float:
        """Distance from a point to the nearest obstacle, m, to half a cell; infinite outside of the map."""
        row, column = self.cell(x, y)
        return float(self.distances[row, column]) if self.contains(row, column) else math.inf


def load_map(file: Path) -> OccupancyMap:
    """Read a map.

    Raises:
        MapError: file or image cannot be read, or a field is missing or wrong.
    """
    fields = _read_yaml(file)
    image = _text(file, fields, 'image')
    resolution = _number(file, fields, 'resolution')
    if not 0.0 < resolution < 100.0:
        raise MapError(file, 'resolution', f'{resolution} m per pixel is not a resolution')
    origin = fields.get('origin')
    if not (isinstance(origin, list) and len(origin) == 3 and all(_is_number(value) for value in origin)):
        raise MapError(file, 'origin', f'expected [x, y, yaw] in m, m and rad, got {origin!r}')
    occupied = _number(file, fields, 'occupied_thresh')
    free = _number(file, fields, 'free_thresh')
    if not 0.0 <= free < occupied <= 1.0:
        raise MapError(
            file, 'free_thresh', f'{free} and occupied_thresh {occupied} have to satisfy 0 <= free < occupied <= 1'
        )
    mode = fields.get('mode', 'trinary')
    if mode not in MODES:
        raise MapError(file, 'mode', f'{mode!r} is none of {", ".join(MODES)}')
    negate = fields.get('negate', 0)
    if negate not in (0, 1, True, False):
        raise MapError(file, 'negate', f'expected 0 or 1, got {negate!r}')
    grey, alpha = _read_image(file, file.parent / image)
    cells = _occupancies(grey, alpha, bool(negate), occupied, free, str(mode))
    x, y, yaw = (float(value) for value in origin)
    # The image has its first row at the top, the grid at the bottom.
    return OccupancyMap(numpy.ascontiguousarray(cells[::-1]), resolution, Pose(x, y, yaw))


def _occupancies(
    grey: NDArray[numpy.uint8],
    alpha: NDArray[numpy.uint8] | None,
    negate: bool,
    occupied: float,
    free: float,
    mode: str,
) -> Occupancy:
    if mode == 'raw':
        raw: Occupancy = numpy.where(grey <= OCCUPIED, grey, UNKNOWN).astype(numpy.int8)
        return raw
    shade = grey.astype(numpy.float64) / 255.0
    probability = shade if negate else 1.0 - shade
    between = numpy.full(grey.shape, UNKNOWN, numpy.float64)
    if mode == 'scale':
        between = 1.0 + numpy.rint(98.0 * (probability - free) / (occupied - free))
        if alpha is not None:
            between = numpy.where(alpha < 255, UNKNOWN, between)
    cells: Occupancy = numpy.select(
        [probability > occupied, probability < free], [OCCUPIED, FREE], default=between
    ).astype(numpy.int8)
    return cells


def _read_yaml(file: Path) -> Mapping[str, Any]:
    try:
        if file.stat().st_size > MAX_YAML_BYTES:
            raise MapError(file, '', f'more than {MAX_YAML_BYTES} bytes are not the YAML of a map')
        fields = yaml.safe_load(file.read_text())
    except (OSError, ValueError, RecursionError, yaml.YAMLError) as error:
        raise MapError(file, '', f'cannot be read: {error}; give the YAML file of a map') from error
    if not isinstance(fields, dict):
        raise MapError(file, '', 'is not the YAML file of a map: expected image, resolution, origin and thresholds')
    return fields


def _read_image(file: Path, image: Path) -> tuple[NDArray[numpy.uint8], NDArray[numpy.uint8] | None]:
    try:
        with Image.open(image, formats=('PPM', 'PNG')) as picture:
            if picture.width * picture.height > MAX_CELLS:
                raise MapError(file, 'image', f'{image} has more than {MAX_CELLS} pixels')
            alpha = numpy.asarray(picture.getchannel('A')) if 'A' in picture.getbands() else None
            if picture.mode.startswith('I'):  # 16 bits, which convert() would cut off instead of scaling
                grey = (numpy.asarray(picture) // 257).astype(numpy.uint8)
            else:
                grey = numpy.asarray(picture.convert('L'))
    except (OSError, ValueError, SyntaxError, Image.DecompressionBombError) as error:
        raise MapError(file, 'image', f'{image} cannot be read as PGM or PNG: {error}') from error
    return grey, alpha


def _text(file: Path, fields: Mapping[str, Any], name: str) -> str:
    value = fields.get(name)
    if not isinstance(value, str) or not value:
        raise MapError(file, name, f'expected a file name, got {value!r}')
    return value


def _number(file: Path, fields: Mapping[str, Any], name: str) -> float:
    value = fields.get(name)
    if not _is_number(value):
        raise MapError(file, name, f'expected a number, got {value!r}')
    return float(value)  # type: ignore[arg-type]


def _is_number(value: Any) -> bool:
    # Any bound will do that keeps conversions from overflowing.
    return isinstance(value, int | float) and not isinstance(value, bool) and abs(value) < 1e300
