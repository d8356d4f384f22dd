# SPDX-License-Identifier: BSD-3-Clause
"""The map with plan, driven path, scan, places, goal and robot: in the cells of a terminal, and as an image.

Only the image needs Pillow, which is imported on first use.

A cell has 2 x 4 braille dots. They are square if a cell is twice as high as wide.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from enum import Enum
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Final

from flexbt_console.errors import UsageError
from flexbt_console.mirror.records import OCCUPIED, GridMap
from flexbt_console.mirror.view import View
from flexbt_core.values.text import one_line, truncate_middle

from .cells import cut, in_cells, width
from .rendering import blind_text
from .style import Glyphs, glyphs

if TYPE_CHECKING:
    from PIL.Image import Image
    from PIL.ImageDraw import ImageDraw

_DOTS: Final = ((0x01, 0x08), (0x02, 0x10), (0x04, 0x20), (0x40, 0x80))
"""Bits of a braille character, by row and column of the dot (Unicode, Braille Patterns)."""

_MARGIN: Final = 0.5
"""Margin around the known points when no map is known, m."""

_SAMPLES: Final = 4
"""Maximum number of map cells that are sampled for one dot, in each direction. So walls thinner than a dot are drawn,
and a large map costs no more than a small one."""


_NEAR_WALL: Final = 0.1
"""Distance from a wall within which a point of the scan counts as that wall, m."""


class Layer(Enum):
    """The content of a cell of the drawing; the value is its style in a terminal."""

    NOTHING = ''
    WALL = 'wall'
    DRIVEN = 'driven'
    PLAN = 'plan'
    PLACE = 'place'
    SCAN = 'scan'
    GOAL = 'goal'
    CURSOR = 'cursor'
    ROBOT = 'robot'


_MET: Final = '*'

Cell = tuple[str, Layer]
"""A cell of the drawing: its character, '' in the second cell of a wide one, and its layer."""
Point = tuple[float, float]


@dataclass(frozen=True)
class Frame:
    """The part of the world in a drawing of ``columns`` x ``rows`` characters.

    ``x`` and ``y`` are the lower left corner, ``step`` the size of a dot, m.
    """

    columns: int
    rows: int
    x: float
    y: float
    step: float

    def dot(self, point: Point) -> tuple[int, int] | None:
        """Return column and row (from the top) of the dot at a point; None if the point is outside."""
        column = math.floor((point[0] - self.x) / self.step)
        row = 4 * self.rows - 1 - math.floor((point[1] - self.y) / self.step)
        if 0 <= column < 2 * self.columns and 0 <= row < 4 * self.rows:
            return column, row
        return None

    def cell(self, point: Point) -> tuple[int, int] | None:
        """Return column and row (from the top) of the character at a point; None if the point is outside."""
        dot = self.dot(point)
        return None if dot is None else (dot[0] // 2, dot[1] // 4)

    def centre(self, column: int, row: int) -> Point:
        """Return the point at the centre of a character."""
        return self.x + (2 * column + 1) * self.step, self.y + (4 * (self.rows - row) - 2) * self.step


def frame_for(view: View, columns: int, rows: int) -> Frame:
    """Return the smallest frame that shows the whole map; if no map is known, all points that are drawn."""
    around, robot = view.drawn, view.robot_pose
    if around.map is not None:
        (left, bottom), (width, height) = (around.map.x, around.map.y), around.map.size
    else:
        poses = [(pose.x, pose.y) for pose in (*view.places.values(), *([robot] if robot else []))]
        points = [*poses, *around.plan, *around.driven, *around.scan] or [(0.0, 0.0)]
        left, bottom = (min(one[axis] for one in points) - _MARGIN for axis in (0, 1))
        width, height = (max(one[axis] for one in points) + _MARGIN - low for axis, low in ((0, left), (1, bottom)))
    step = max(width / (2 * columns), height / (4 * rows), 1e-3) * 1.0001
    return Frame(
        columns, rows, left - (2 * columns * step - width) / 2.0, bottom - (4 * rows * step - height) / 2.0, step
    )


def draw_map(
    view: View, cursor: Point | None, columns: int, rows: int, signs: Glyphs
) -> tuple[Frame, list[list[Cell]]]:
    """Return the frame, and its cells row by row from the top. Points of the scan near a wall are omitted."""
    around, robot, places = view.drawn, view.robot_pose, view.places
    frame = frame_for(view, columns, rows)
    dots: dict[tuple[int, int], Layer] = {}
    walls = _wall_dots(around.map, frame) if around.map is not None else frozenset()
    dots.update(dict.fromkeys(walls, Layer.WALL))
    for path, layer in ((around.driven, Layer.DRIVEN), (around.plan, Layer.PLAN)):
        dots.update(dict.fromkeys(_line_dots(path, frame), layer))
    drawn = _characters(dots, frame, signs)
    for pose in places.values():
        _write(drawn, frame, (pose.x, pose.y), signs.place, Layer.PLACE)
    for name, pose in places.items():
        _write_name(drawn, frame.cell((pose.x, pose.y)), one_line(name))
    for column, row in _met(around.scan, walls, frame):
        _put(drawn[row], column, (_MET, Layer.SCAN))
    if around.goal is not None:
        _write(drawn, frame, around.goal, signs.goal, Layer.GOAL)
    if robot is not None:
        heading = round(robot.yaw / (math.tau / 8.0)) % 8
        _write(drawn, frame, (robot.x, robot.y), signs.robot[heading], Layer.ROBOT)
    if cursor is not None:
        _write(drawn, frame, cursor, signs.cursor, Layer.CURSOR)
    return frame, drawn


def _characters(dots: Mapping[tuple[int, int], Layer], frame: Frame, signs: Glyphs) -> list[list[Cell]]:
    order = list(Layer)
    bits: dict[tuple[int, int], int] = {}
    layers: dict[tuple[int, int], Layer] = {}
    for (column, row), layer in dots.items():
        at = column // 2, row // 4
        bits[at] = bits.get(at, 0) | _DOTS[row % 4][column % 2]
        layers[at] = max(layers.get(at, layer), layer, key=order.index)
    nothing: Cell = ' ', Layer.NOTHING
    drawn = [[nothing] * frame.columns for _ in range(frame.rows)]
    for (column, row), layer in layers.items():
        ascii_sign = '#' if layer is Layer.WALL else '.'
        sign = chr(0x2800 + bits[column, row]) if signs.has_braille else ascii_sign
        drawn[row][column] = sign, layer
    return drawn


def _write(drawn: list[list[Cell]], frame: Frame, point: Point, sign: str, layer: Layer) -> None:
    at = frame.cell(point)
    if at is not None:
        _put(drawn[at[1]], at[0], (sign, layer))


def _put(row: list[Cell], column: int, cell: Cell) -> None:
    """Replace a cell; if it belonged to a wide character, erase the other cell of that character."""
    if not row[column][0]:
        row[column - 1] = ' ', row[column - 1][1]
    if column + 1 < len(row) and not row[column + 1][0]:
        row[column + 1] = ' ', row[column + 1][1]
    row[column] = cell


def _write_name(drawn: list[list[Cell]], at: tuple[int, int] | None, name: str) -> None:
    """Write a name to the right, left, above or below its sign, where it covers no other place or name.

    If none of these fits, write the beginning of the name to the right, as far as it fits.
    """
    if at is None or not name:
        return
    (column, row), columns = at, len(drawn[0])

    def is_free(begin: int, line: int, count: int) -> bool:
        is_inside = 0 <= line < len(drawn) and begin >= 0 and begin + count <= columns
        cells = range(max(0, begin - 1), min(columns, begin + count + 1))  # with one cell of space on both sides
        return is_inside and all((cell, line) == at or drawn[line][cell][1] is not Layer.PLACE for cell in cells)

    wide = width(name)
    middle = max(0, min(column - wide // 2, columns - wide))
    tried = ((column + 1, row), (column - wide, row), (middle, row - 1), (middle, row + 1))
    begin, line = next((one for one in tried if is_free(*one, wide)), tried[0])
    room = next((count for count in range(wide, 0, -1) if is_free(begin, line, count)), 0)
    for cell, character in enumerate(in_cells(cut(name, room)), begin):
        drawn[line][cell] = character, Layer.PLACE


def map_lines(view: View, size: tuple[int, int]) -> list[str]:
    """Return the map as lines. ``size`` is in columns and rows; the last two lines are the pose of the robot and the
    legend."""
    signs, columns, rows = glyphs(), size[0], max(1, size[1] - 2)
    _, cells = draw_map(view, None, columns, rows, signs)
    legend = f'{signs.robot[0]} robot  {signs.goal} goal  {signs.place} place  {_MET} met by the lidar'
    drawn = [''.join(sign for sign, _ in row).rstrip() for row in cells]
    return [*drawn, *(cut(line, columns) for line in (where_text(view), legend))]


def where_text(view: View) -> str:
    """Return the line with the pose of the robot and the length of its plan, or the reason why they are unknown."""
    robot = view.robot_pose
    blind = blind_text(view.snapshot) if view.snapshot else ''
    where = f'x {robot.x:.2f} y {robot.y:.2f} yaw {robot.yaw:.2f}' if robot is not None else blind or 'pose unknown'
    if view.decision is not None and (lacking := view.lacks(view.decision)):
        return f'{one_line(lacking)} NOT RECEIVED  {where}'
    plan = f'plan {view.drawn.plan_length:.1f} m' if view.drawn.plan else ''
    return '  '.join(filter(None, (where, plan, blind if robot is not None else '')))


@functools.lru_cache(maxsize=1)
def _wall_dots(map: GridMap, frame: Frame) -> frozenset[tuple[int, int]]:
    """Return the dots (column, row) of walls. Cached for the latest map and frame."""
    found: set[tuple[int, int]] = set()
    count = min(_SAMPLES, max(1, math.ceil(frame.step / map.resolution)))
    offsets = [(number + 0.5) / count * frame.step for number in range(count)]
    dots: dict[int, list[int]] = {}  # columns of dots, by the column of the map that they show
    for column in range(2 * frame.columns):
        left = frame.x + column * frame.step
        for cell in {math.floor((left + offset - map.x) / map.resolution) for offset in offsets}:
            dots.setdefault(cell, []).append(column)
    for row in range(4 * frame.rows):
        bottom = frame.y + (4 * frame.rows - 1 - row) * frame.step
        for line in {math.floor((bottom + offset - map.y) / map.resolution) for offset in offsets}:
            for cell in map.occupied_columns(line):
                found.update((column, row) for column in dots.get(cell, ()))
    return frozenset(found)


def _met(scan: Iterable[Point], walls: frozenset[tuple[int, int]], frame: Frame) -> Iterable[tuple[int, int]]:
    """Return columns and rows of the characters with a point of the scan that is not near a wall of the map."""
    reach = math.ceil(_NEAR_WALL / frame.step)
    near = range(-reach, reach + 1)
    known: set[tuple[int, int]] = set()
    for dot in {frame.dot(point) for point in scan} - {None}:
        assert dot is not None
        if not any((dot[0] + across, dot[1] + down) in walls for across in near for down in near):
            known.add((dot[0] // 2, dot[1] // 4))
    return known


def _line_dots(points: tuple[Point, ...], frame: Frame) -> Iterable[tuple[int, int]]:
    for start, end in pairwise(points):
        count = max(1, min(1000, math.ceil(math.dist(start, end) / frame.step)))
        for number in range(count + 1):
            share = number / count
            dot = frame.dot((start[0] + share * (end[0] - start[0]), start[1] + share * (end[1] - start[1])))
            if dot is not None:
                yield dot


# The map as an image.

PIXELS: Final = 1200
"""Length of the longer side of the image, pixels."""

_GRAYS: Final = bytes(40 if OCCUPIED <= value <= 100 else 255 if value < OCCUPIED else 205 for value in range(256))
"""Gray levels of occupied, free and unknown cells, as map_server draws them: dark, white and gray."""

_DRIVEN: Final = '#8a8a8a'
_PLAN: Final = '#0072b2'
_SCAN: Final = '#d55e00'
_PLACE: Final = '#7a5c00'
_GOAL: Final = '#cc1177'
_ROBOT: Final = '#008a5e'


def map_image(view: View) -> Image:
    """Return the map as an image whose longer side has :data:`PIXELS` pixels."""
    from PIL import Image, ImageDraw, ImageFont  # only needed for an image

    around, robot, places = view.drawn, view.robot_pose, view.places
    wide = frame_for(view, PIXELS // 2, PIXELS // 4)
    pad = (PIXELS - _extent(around.map, wide, 0)) // 2, (PIXELS - _extent(around.map, wide, 1)) // 2
    image = Image.new('RGB', (PIXELS, PIXELS), '#cdcdcd')
    if around.map is not None:
        _paste(image, around.map, wide)
    draw = ImageDraw.Draw(image)

    def at(point: Point) -> Point:
        return (point[0] - wide.x) / wide.step, PIXELS - (point[1] - wide.y) / wide.step

    draw.line([at(point) for point in around.driven], _DRIVEN, 3)
    draw.line([at(point) for point in around.plan], _PLAN, 4)
    for point in around.scan:
        _disc(draw, at(point), 2.0, _SCAN)
    font = ImageFont.load_default(18)
    for name, pose in places.items():
        x, y = at((pose.x, pose.y))
        _disc(draw, (x, y), 5.0, _PLACE)
        text = one_line(name, 40)
        room = PIXELS - pad[0] - 8.0 - draw.textlength(text, font)
        draw.text((min(x + 8.0, room), y - 10.0), text, _PLACE, font, stroke_width=2, stroke_fill='white')
    if around.goal is not None:
        x, y = at(around.goal)
        draw.ellipse((x - 11, y - 11, x + 11, y + 11), outline=_GOAL, width=4)
    if robot is not None:
        x, y = at((robot.x, robot.y))
        corners = ((18.0, 0.0), (12.0, 2.5), (12.0, -2.5))
        draw.polygon([(x + r * math.cos(robot.yaw + a), y - r * math.sin(robot.yaw + a)) for r, a in corners], _ROBOT)
    return image.crop((pad[0], pad[1], PIXELS - pad[0], PIXELS - pad[1]))


def save_map(file: Path, view: View) -> None:
    """Write the map as PNG, whatever the suffix of ``file``.

    Raises:
        UsageError: the file cannot be written.
    """
    image = map_image(view)
    try:
        image.save(file, 'PNG')
    except OSError as error:
        raise UsageError(
            f'the picture cannot be written to {truncate_middle(str(file), 200)!r}: {error.strerror or error}'
        ) from None


def _extent(map: GridMap | None, frame: Frame, axis: int) -> int:
    """Return the length of a side of the map in the square image, pixels."""
    return PIXELS if map is None else min(PIXELS, math.ceil(map.size[axis] / frame.step) + 2)


def _paste(image: Image, map: GridMap, frame: Frame) -> None:
    import numpy
    from PIL import Image

    width, height = (max(1, round(side / frame.step)) for side in map.size)
    cells = numpy.frombuffer(map.cells.translate(_GRAYS), numpy.uint8).reshape(map.height, map.width)[::-1]
    for axis, room in enumerate((height, width)):  # the darkest cell of a pixel counts, so that thin walls remain
        if (count := cells.shape[axis]) > room:
            cells = numpy.minimum.reduceat(cells, [pixel * count // room for pixel in range(room)], axis)
    left, top = (map.x - frame.x) / frame.step, PIXELS - (map.y + map.size[1] - frame.y) / frame.step
    pixels = Image.fromarray(cells).resize((width, height), Image.Resampling.NEAREST)
    image.paste(pixels, (round(left), round(top)))


def _disc(draw: ImageDraw, at: Point, radius: float, colour: str) -> None:
    draw.ellipse((at[0] - radius, at[1] - radius, at[0] + radius, at[1] + radius), colour)
