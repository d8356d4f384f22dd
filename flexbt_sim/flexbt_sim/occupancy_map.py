# SPDX-License-Identifier: BSD-3-Clause
"""Maps as ROS's map_server reads them: a YAML file that names an image."""

from __future__ import annotations

import math
import reprlib
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

MAX_YAML_BYTES: Final = 20_000
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
    """Read a map. Fields, modes and thresholds mean what they mean to Nav2's map_server (Jazzy).

    The image is a PGM, PNG or BMP, named relative to the YAML file or absolutely. ``negate`` and ``mode`` may be left
    out.

    Raises:
        MapError: file or image cannot be read, or a field is missing or wrong.
    """
    fields = _read_yaml(file)
    image = fields.get('image')
    if not isinstance(image, str) or not image:
        raise MapError(file, 'image', f'expected a file name, got {_shown(image)}')
    resolution = _number(file, fields, 'resolution')
    if not 0.0 < resolution < 100.0:
        raise MapError(file, 'resolution', f'{resolution} m per pixel is not a resolution')
    origin = fields.get('origin')
    numbers = [_finite(value) for value in origin] if isinstance(origin, list) and len(origin) == 3 else [None]
    if None in numbers:
        raise MapError(file, 'origin', f'expected [x, y, yaw] in m, m and rad, got {_shown(origin)}')
    occupied = _number(file, fields, 'occupied_thresh')
    free = _number(file, fields, 'free_thresh')
    if not 0.0 <= free < occupied <= 1.0:
        raise MapError(
            file, 'free_thresh', f'{free} and occupied_thresh {occupied} have to satisfy 0 <= free < occupied <= 1'
        )
    mode = fields.get('mode', 'trinary')
    if not isinstance(mode, str) or mode.lower() not in MODES:
        raise MapError(file, 'mode', f'{_shown(mode)} is none of {", ".join(MODES)}')
    negate = fields.get('negate', 0)
    if negate not in (0, 1):
        raise MapError(file, 'negate', f'expected 0 or 1, got {_shown(negate)}')
    grey, transparent = _read_image(file, file.parent / image)
    cells = _occupancies(mode.lower(), bool(negate), occupied, free)[grey]
    if mode.lower() != 'raw':
        cells[transparent] = UNKNOWN
    x, y, yaw = (float(number) for number in numbers if number is not None)
    # The image has its first row at the top, the grid at the bottom.
    return OccupancyMap(numpy.ascontiguousarray(cells[::-1]), resolution, Pose(x, y, yaw))


def _occupancies(mode: str, negate: bool, occupied: float, free: float) -> Occupancy:
    """What each of the 256 grey values means."""
    grey = numpy.arange(256)
    if mode == 'raw':
        return numpy.where(grey <= OCCUPIED, grey, UNKNOWN).astype(numpy.int8)
    occupancy = (grey if negate else 255 - grey) / 255.0
    between = numpy.rint(OCCUPIED * (occupancy - free) / (occupied - free)) if mode == 'scale' else UNKNOWN
    return numpy.select([occupancy >= occupied, occupancy <= free], [OCCUPIED, FREE], between).astype(numpy.int8)


def _read_yaml(file: Path) -> Mapping[str, Any]:
    try:
        _require_file(file)
        if file.stat().st_size > MAX_YAML_BYTES:
            raise ValueError(f'more than {MAX_YAML_BYTES} bytes are not the YAML of a map')
        fields = yaml.safe_load(file.read_text())
        if not isinstance(fields, dict):
            raise ValueError('image, resolution, origin and thresholds are missing')
    except (OSError, ValueError, RecursionError, yaml.YAMLError) as error:
        raise MapError(file, '', f'cannot be read: {_line(error)}; give the YAML file of a map') from error
    return fields


def _read_image(file: Path, image: Path) -> tuple[NDArray[numpy.uint8], NDArray[numpy.bool_]]:
    """Grey values, and which pixels are not opaque. Colours have the brightness that ITU-R BT.709 gives them."""
    try:
        _require_file(image)
        with Image.open(image, formats=('PPM', 'PNG', 'BMP')) as picture:
            if not 0 < picture.width * picture.height <= MAX_CELLS:
                raise ValueError(f'{picture.width} x {picture.height} pixels; a map has 1 to {MAX_CELLS}')
            if picture.mode.startswith('I'):  # 16 bits, which convert() would cut off instead of scaling
                grey = numpy.rint(numpy.asarray(picture) / 257.0).astype(numpy.uint8)
                return grey, numpy.zeros(grey.shape, bool)
            if picture.mode == 'F':
                raise ValueError('pixels are floating point numbers')
            colours = picture.convert('RGBA')
            grey = numpy.asarray(colours.convert('RGB').convert('L', (0.212656, 0.715158, 0.072186, 0.0)))
            return grey, numpy.asarray(colours.getchannel('A')) < 255
    except (OSError, ValueError, SyntaxError, Image.DecompressionBombError) as error:
        raise MapError(file, 'image', f'{image} cannot be read as PGM, PNG or BMP: {_line(error)}') from error


def _require_file(path: Path) -> None:
    """Neither a directory, nor a device or a pipe, which might never end. Raises OSError."""
    if path.exists() and not path.is_file():
        raise OSError('not a regular file')


def _number(file: Path, fields: Mapping[str, Any], name: str) -> float:
    number = _finite(fields.get(name))
    if number is None:
        raise MapError(file, name, f'expected a number, got {_shown(fields.get(name))}')
    return number


def _finite(value: Any) -> float | None:
    """A finite number, also one that YAML 1.1 takes for text, such as the 1e-16 that map_saver writes."""
    try:
        number = float(value) if isinstance(value, int | float | str) and not isinstance(value, bool) else math.nan
    except (ValueError, OverflowError):
        return None
    return number if math.isfinite(number) else None


def _shown(value: object) -> str:
    """Enough of a value of the file to recognise it: an alias can stand for millions of values."""
    return reprlib.repr(value)[:80]


def _line(error: Exception) -> str:
    return ' '.join(str(error).split())[:200]
