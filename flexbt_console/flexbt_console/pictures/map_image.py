# SPDX-License-Identifier: BSD-3-Clause
"""The map as an image: walls, what the lidar meets, plan, driven path, places, goal, and the robot."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Final

from flexbt_console.errors import UsageError
from flexbt_console.mirror import OCCUPIED, GridMap, Pose, Surroundings
from flexbt_core.values import excerpt, one_line

from .map_canvas import Frame, Point, frame_for

if TYPE_CHECKING:
    from PIL.Image import Image
    from PIL.ImageDraw import ImageDraw

PIXELS: Final = 1200
"""Of the longer side."""

_GRAYS: Final = bytes(40 if OCCUPIED <= value <= 100 else 255 if value < OCCUPIED else 205 for value in range(256))
"""What is occupied, free and unknown, as map_server draws it: dark, white and gray."""

_DRIVEN: Final = '#8a8a8a'
_PLAN: Final = '#0072b2'
_SCAN: Final = '#d55e00'
_PLACE: Final = '#7a5c00'
_GOAL: Final = '#cc1177'
_ROBOT: Final = '#008a5e'


def map_image(around: Surroundings, robot: Pose | None, places: Mapping[str, Pose]) -> Image:
    """The map, its longer side of :data:`PIXELS`."""
    from PIL import Image, ImageDraw, ImageFont  # what only an image needs

    points = [(pose.x, pose.y) for pose in (*places.values(), *([robot] if robot else []))]
    wide = frame_for(around.map, [*points, *around.plan, *around.driven, *around.scan], PIXELS // 2, PIXELS // 4)
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


def save_map(file: Path, around: Surroundings, robot: Pose | None, places: Mapping[str, Pose]) -> None:
    """Write the map as PNG, whatever the name of the file ends with.

    Raises:
        UsageError: the file cannot be written.
    """
    image = map_image(around, robot, places)
    try:
        image.save(file, 'PNG')
    except OSError as error:
        raise UsageError(
            f'the picture cannot be written to {excerpt(str(file), 200)!r}: {error.strerror or error}'
        ) from None


def _extent(map: GridMap | None, frame: Frame, axis: int) -> int:
    """Pixels that a side takes of the square."""
    return PIXELS if map is None else min(PIXELS, math.ceil(map.size[axis] / frame.step) + 2)


def _paste(image: Image, map: GridMap, frame: Frame) -> None:
    from PIL import Image, ImageFilter

    cells = Image.frombytes('L', (map.width, map.height), map.cells.translate(_GRAYS))
    cells = cells.transpose(Image.Transpose.FLIP_TOP_BOTTOM)
    width, height = (max(1, round(side / frame.step)) for side in map.size)
    if cells.width > width:  # a wall that is thinner than a pixel stays: of the cells of a pixel the darkest counts
        cells = cells.filter(ImageFilter.MinFilter(2 * math.ceil(cells.width / width / 2) + 1))
    left, top = (map.x - frame.x) / frame.step, PIXELS - (map.y + map.size[1] - frame.y) / frame.step
    image.paste(cells.resize((width, height), Image.Resampling.NEAREST), (round(left), round(top)))


def _disc(draw: ImageDraw, at: Point, radius: float, colour: str) -> None:
    draw.ellipse((at[0] - radius, at[1] - radius, at[0] + radius, at[1] + radius), colour)
