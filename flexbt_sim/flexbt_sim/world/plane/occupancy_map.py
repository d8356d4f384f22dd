# SPDX-License-Identifier: BSD-3-Clause
"""Maps in the format of ROS's map_server: a YAML file that names an image."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import product
from pathlib import Path
from typing import Any, Final

import numpy
import scipy
from numpy.typing import NDArray
from PIL import Image

from flexbt_core.values.json_data import finite_number
from flexbt_core.values.text import one_line, short_repr
from flexbt_core.values.text_files import read_text
from flexbt_core.values.yaml_data import load_yaml
from flexbt_sim.errors import MapError, MapImageError

from .geometry import FARTHEST, Pose, Shape
from .loops import nearest

FREE: Final = 0
OCCUPIED: Final = 100
UNKNOWN: Final = -1
MODES: Final = ('trinary', 'scale', 'raw')

MAX_YAML_BYTES: Final = 20_000
MAX_CELLS: Final = 16_000_000
"""Size of the largest map, cells: 4,000 rows of 4,000. Computing all its distances takes about 1 GB of memory for some
seconds; keeping them takes 0.4 GB."""

MIN_RESOLUTION: Final = 0.001
MAX_RESOLUTION: Final = 100.0
"""Range of the size of a cell, m. The search for obstacles within reach of the robot goes cell by cell."""

FAR: Final = 1e9
"""Distance, m, that represents no obstacle."""

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
        """Number of rows."""
        return int(self.cells.shape[0])

    @property
    def width(self) -> int:
        """Number of columns."""
        return int(self.cells.shape[1])

    @cached_property
    def obstacles(self) -> NDArray[numpy.bool_]:
        """Mask of the cells that are obstacles: occupied more likely than not. The area outside the map counts as
        free."""
        obstacles: NDArray[numpy.bool_] = self.cells > OCCUPIED // 2
        return obstacles

    @cached_property
    def half_cell_distances(self) -> Distances:
        """Distances to the nearest obstacle, m, at corners, edges (their middles) and centres of the cells.

        Shape (2 * height + 1, 2 * width + 1): ``[2 * row, 2 * column]`` is the lower left corner of a cell, ``[2 * row
        + 1, 2 * column + 1]`` its centre. The distances to the nearest point of an obstacle cell are exact, since that
        point is again a corner, a middle or a centre. They are ``FAR`` on a map without obstacles.
        """
        touched = numpy.zeros((2 * self.height + 1, 2 * self.width + 1), bool)
        for row, column in product(range(3), repeat=2):
            touched[row : row + 2 * self.height : 2, column : column + 2 * self.width : 2] |= self.obstacles
        if not self.obstacles.any():
            return numpy.full(touched.shape, FAR, numpy.float32)
        nearest = scipy.ndimage.distance_transform_edt(~touched, return_distances=False, return_indices=True)
        distances: Distances = numpy.empty(touched.shape, numpy.float32)
        columns = numpy.arange(touched.shape[1], dtype=numpy.int32)
        for row, (up, right) in enumerate(
            zip(*nearest, strict=True)
        ):  # row by row: all at once would take twice the memory
            distances[row] = numpy.sqrt(
                numpy.square(up - row, dtype=float) + numpy.square(right - columns, dtype=float)
            )
        distances *= self.resolution / 2.0
        return distances

    @property
    def distances(self) -> Distances:
        """Distance from the centre of each cell to the nearest point of an obstacle cell, m; 0 in an obstacle."""
        return self.half_cell_distances[1::2, 1::2]

    def grid_position(self, x: float, y: float) -> tuple[float, float]:
        """Return a point of the map frame in cells (up, right) from the lower left corner of the grid."""
        dx, dy = x - self.origin.x, y - self.origin.y
        cos, sin = math.cos(self.origin.yaw), math.sin(self.origin.yaw)
        return (dy * cos - dx * sin) / self.resolution, (dx * cos + dy * sin) / self.resolution

    def cell(self, x: float, y: float) -> tuple[int, int]:
        """Return the row and column of a point of the map frame; they may be outside the grid."""
        row, column = self.grid_position(x, y)
        return math.floor(row), math.floor(column)

    def point(self, row: float, column: float) -> tuple[float, float]:
        """Return the centre of a cell, in the map frame."""
        u, v = (column + 0.5) * self.resolution, (row + 0.5) * self.resolution
        cos, sin = math.cos(self.origin.yaw), math.sin(self.origin.yaw)
        return self.origin.x + u * cos - v * sin, self.origin.y + u * sin + v * cos

    def contains(self, row: int, column: int) -> bool:
        """Return whether a cell is part of the grid."""
        return 0 <= row < self.height and 0 <= column < self.width

    def mask(self, areas: Iterable[tuple[Shape, Pose]]) -> OccupancyMap:
        """Return a grid of the same geometry that is occupied in each cell that a shape touches, and free elsewhere."""
        cells = numpy.full(self.cells.shape, FREE, numpy.int8)
        for shape, pose in areas:
            corners = numpy.array([self.grid_position(*point) for point in shape.points(pose)])
            (y, x), (to_y, to_x) = corners.T, numpy.roll(corners, -1, axis=0).T
            low, high = numpy.minimum(y, to_y), numpy.maximum(y, to_y)
            up, right = to_y - y, to_x - x
            rise = numpy.where(up == 0.0, 1.0, up)
            bottom, top = math.floor(low.min()), math.ceil(high.max())
            for row in range(max(0, bottom), min(self.height, max(top, bottom + 1))):
                # What the sides cover in the row, and what is between them in its middle.
                start = numpy.where(up == 0.0, 0.0, (numpy.clip(row, low, high) - y) / rise)
                end = numpy.where(up == 0.0, 1.0, (numpy.clip(row + 1.0, low, high) - y) / rise)
                here = (low <= row + 1.0) & (high >= row)
                covered = numpy.sort([x + start * right, x + end * right], axis=0).T[here]
                crossing = (y > row + 0.5) != (to_y > row + 0.5)
                between = numpy.sort((x + (row + 0.5 - y) / rise * right)[crossing]).reshape(-1, 2)
                for ends in (covered, between):
                    for first, last in numpy.clip(numpy.floor(ends), -1, self.width).astype(int):
                        cells[row, max(0, first) : last + 1] = OCCUPIED
        return replace(self, cells=cells)

    def masked(self, mask: OccupancyMap) -> OccupancyMap:
        """Return this map with the cells whose centres are in occupied cells of another grid occupied, too."""
        places = numpy.array([mask.grid_position(*self.point(*cell)) for cell in ((0, 0), (1, 0), (0, 1))])
        turn = (places[1:] - places[0]).T
        covered = scipy.ndimage.affine_transform(
            mask.obstacles.astype(numpy.uint8), turn, places[0] - 0.5, self.cells.shape, order=0, mode='grid-constant'
        )
        return replace(self, cells=numpy.where(covered, numpy.int8(OCCUPIED), self.cells))

    def clearance(self, x: float, y: float) -> float:
        """Return the exact distance from a point, on the map or outside it, to the nearest obstacle, m; infinite
        without one."""
        row, column = self.grid_position(x, y)
        known, beside = self._nearest_known(row, column)
        reach = (known + beside) / self.resolution + 1.0
        return float(nearest(self.obstacles, self.obstacles, False, row, column, reach)) * self.resolution

    def _nearest_known(self, row: float, column: float) -> tuple[float, float]:
        """Return the obstacle distance at the nearest point with a known one, and the distance to that point; m."""
        r = min(max(round(2.0 * row), 0), 2 * self.height)
        c = min(max(round(2.0 * column), 0), 2 * self.width)
        beside = math.hypot(row - r / 2.0, column - c / 2.0) * self.resolution
        return float(self.half_cell_distances[r, c]), beside


def load_map(file: Path) -> OccupancyMap:
    """Read a map. Fields, modes and thresholds have the meaning of Nav2's map_server (Jazzy).

    The image is a PGM, PNG or BMP, with a path that is absolute or relative to the YAML file. ``negate`` and ``mode``
    are optional.

    Raises:
        MapError: the file or image cannot be read, or a field is missing or wrong.
    """
    fields = _read_yaml(file)
    image = fields.get('image')
    if not isinstance(image, str) or not image:
        raise MapError(file, 'image', f'expected a file name, got {short_repr(image)}')
    resolution = _number(file, fields, 'resolution')
    if not MIN_RESOLUTION <= resolution <= MAX_RESOLUTION:
        raise MapError(
            file, 'resolution', f'{resolution:g} m per pixel; expected {MIN_RESOLUTION:g} to {MAX_RESOLUTION:g}'
        )
    origin = fields.get('origin')
    numbers = [finite_number(value) for value in origin] if isinstance(origin, list) and len(origin) == 3 else [None]
    if None in numbers:
        raise MapError(file, 'origin', f'expected [x, y, yaw] in m, m and rad, got {short_repr(origin)}')
    occupied = _number(file, fields, 'occupied_thresh')
    free = _number(file, fields, 'free_thresh')
    if not 0.0 <= free < occupied <= 1.0:
        raise MapError(
            file, 'free_thresh', f'{free} and occupied_thresh {occupied} have to satisfy 0 <= free < occupied <= 1'
        )
    mode = fields.get('mode', 'trinary')
    if not isinstance(mode, str) or mode.lower() not in MODES:
        raise MapError(file, 'mode', f'{short_repr(mode)} is none of {", ".join(MODES)}')
    negate = fields.get('negate', 0)
    if negate not in (0, 1):
        raise MapError(file, 'negate', f'expected 0 or 1, got {short_repr(negate)}')
    grey, transparent = _read_image(file, file.parent / image)
    cells = _occupancies(mode.lower(), bool(negate), occupied, free)[grey]
    if mode.lower() != 'raw':
        cells[transparent] = UNKNOWN
    x, y, yaw = (float(number) for number in numbers if number is not None)
    pose = Pose(x, y, yaw)
    if not pose.is_place:
        raise MapError(file, 'origin', f'{short_repr(origin)} is not a place: more than {FARTHEST:g} m away')
    # The image has its first row at the top, the grid at the bottom.
    return OccupancyMap(numpy.ascontiguousarray(cells[::-1]), resolution, pose)


def _occupancies(mode: str, negate: bool, occupied: float, free: float) -> Occupancy:
    """Return the occupancy of each of the 256 grey values."""
    grey = numpy.arange(256)
    if mode == 'raw':
        return numpy.where(grey <= OCCUPIED, grey, UNKNOWN).astype(numpy.int8)
    occupancy = (grey if negate else 255 - grey) / 255.0
    between = numpy.rint(OCCUPIED * (occupancy - free) / (occupied - free)) if mode == 'scale' else UNKNOWN
    return numpy.select([occupancy >= occupied, occupancy <= free], [OCCUPIED, FREE], between).astype(numpy.int8)


def _read_yaml(file: Path) -> Mapping[str, Any]:
    try:
        fields = load_yaml(read_text(file, MAX_YAML_BYTES), aliases=True)
        if not isinstance(fields, dict):
            raise ValueError('image, resolution, origin and thresholds are missing')
    except (OSError, ValueError) as error:
        raise MapError.unreadable(file, error, 'the YAML file of a map') from error
    return fields


def _read_image(file: Path, image: Path) -> tuple[NDArray[numpy.uint8], NDArray[numpy.bool_]]:
    """Return the grey values and a mask of the pixels that are not opaque. Colours are converted by ITU-R BT.709."""
    try:
        _require_file(image)
        with Image.open(image, formats=('PPM', 'PNG', 'BMP')) as picture:
            if not 0 < picture.width * picture.height <= MAX_CELLS:
                size = f'{picture.width} x {picture.height} pixels'
                raise ValueError(f'{size}; a map has 1 to {MAX_CELLS}: a coarser resolution needs fewer')
            if picture.mode.startswith('I'):  # 16 bits, which convert() would clip instead of scaling
                grey = numpy.rint(numpy.asarray(picture) / 257.0).astype(numpy.uint8)
                return grey, numpy.zeros(grey.shape, bool)
            if picture.mode == 'F':
                raise ValueError('pixels are floating point numbers')
            colours = picture.convert('RGBA')
            grey = numpy.asarray(colours.convert('RGB').convert('L', (0.212656, 0.715158, 0.072186, 0.0)))
            return grey, numpy.asarray(colours.getchannel('A')) < 255
    except (OSError, ValueError, SyntaxError, Image.DecompressionBombError) as error:
        raise MapImageError(
            file, 'image', f'{image} cannot be read as PGM, PNG or BMP: {one_line(str(error), 200)}'
        ) from error


def _require_file(path: Path) -> None:
    """Require a regular file: reading a device or a pipe might never end. Raises OSError."""
    if path.exists() and not path.is_file():
        raise OSError('not a regular file')


def _number(file: Path, fields: Mapping[str, Any], name: str) -> float:
    number = finite_number(fields.get(name))
    if number is None:
        raise MapError(file, name, f'expected a number, got {short_repr(fields.get(name))}')
    return number
