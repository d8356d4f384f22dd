# SPDX-License-Identifier: BSD-3-Clause
"""The summary picture of a demonstration: map, paths planned, path driven, goals."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

Color = tuple[int, int, int]
Point = tuple[float, float]

FREE: Color = (255, 255, 255)
OCCUPIED: Color = (52, 58, 64)
UNKNOWN: Color = (206, 212, 218)
INK: Color = (33, 37, 41)
PLANNED: Color = (34, 139, 230)
DRIVEN: Color = (232, 89, 12)
REACHED: Color = (47, 158, 68)
NOT_REACHED: Color = (134, 142, 150)
START: Color = (112, 72, 232)

# The picture is at least this wide, in pixels, whatever the resolution of the map.
WIDTH = 900
MARGIN = 16
LEGEND_ROW = 24
OCCUPIED_FROM = 65  # nav_msgs/OccupancyGrid: percent from which a cell counts as occupied


@dataclass(frozen=True)
class MapImage:
    """An occupancy grid: `cells` as rows from the bottom up, in percent, -1 for unknown; metres elsewhere."""

    cells: NDArray[np.int8]
    resolution: float
    origin: Point


@dataclass(frozen=True)
class GoalMark:
    """A goal: label, pose in the map frame (m, m, rad), and whether the robot was there."""

    label: str
    x: float
    y: float
    yaw: float
    reached: bool


@dataclass(frozen=True)
class DemoPicture:
    """What a summary picture shows. Points are metres in the map frame."""

    title: str
    map: MapImage
    start: Point
    planned: Sequence[Sequence[Point]]
    driven: Sequence[Point]
    goals: Sequence[GoalMark]


def write_picture(picture: DemoPicture, file: Path) -> None:
    """Draw `picture` and write it as PNG to `file`, whose directory is made when missing."""
    file.parent.mkdir(parents=True, exist_ok=True)
    draw_picture(picture).quantize(64).save(file, optimize=True)


def draw_picture(picture: DemoPicture) -> Image.Image:
    """Draw `picture`: title on top, map with its layers in the middle, legend below."""
    canvas = _Canvas(picture.map, picture.title)
    for path in picture.planned:
        canvas.line(path, PLANNED, width=7)
    canvas.line(picture.driven, DRIVEN, width=3)
    canvas.spot(picture.start, START)
    for goal in picture.goals:
        canvas.goal(goal)
    canvas.legend()
    return canvas.image


class _Canvas:
    """The image, and how metres of the map become its pixels."""

    def __init__(self, grid: MapImage, title: str) -> None:
        rows, columns = grid.cells.shape
        self._scale = max(1.0, WIDTH / columns) / grid.resolution  # pixels per metre
        self._origin = grid.origin
        width = round(columns * grid.resolution * self._scale)
        self._height = round(rows * grid.resolution * self._scale)
        self._font = ImageFont.load_default(size=15)
        self._top = MARGIN + LEGEND_ROW
        self.image = Image.new('RGB', (width + 2 * MARGIN, self._top + self._height + LEGEND_ROW + 2 * MARGIN), FREE)
        self._draw = ImageDraw.Draw(self.image)
        self._draw.text((MARGIN, MARGIN // 2), title, fill=INK, font=ImageFont.load_default(size=18))
        colors = np.full((rows, columns, 3), FREE, dtype=np.uint8)
        colors[grid.cells >= OCCUPIED_FROM] = OCCUPIED
        colors[grid.cells < 0] = UNKNOWN
        area = Image.fromarray(np.flipud(colors)).resize((width, self._height), Image.Resampling.NEAREST)
        self.image.paste(area, (MARGIN, self._top))

    def line(self, points: Sequence[Point], color: Color, width: int) -> None:
        if len(points) > 1:
            self._draw.line([self._pixel(point) for point in points], fill=color, width=width, joint='curve')

    def spot(self, point: Point, color: Color) -> None:
        self._disc(self._pixel(point), 8, color, outline=FREE)

    def goal(self, goal: GoalMark) -> None:
        color = REACHED if goal.reached else NOT_REACHED
        x, y = self._pixel((goal.x, goal.y))
        tip = (x + 26 * math.cos(goal.yaw), y - 26 * math.sin(goal.yaw))
        self._draw.line([(x, y), tip], fill=color, width=4)
        self._disc((x, y), 10, color, outline=FREE)
        self._draw.text((x + 12, y + 8), goal.label, fill=INK, font=self._font, stroke_width=3, stroke_fill=FREE)

    def legend(self) -> None:
        y = self._top + self._height + MARGIN + LEGEND_ROW / 2
        x = float(MARGIN)
        for text, color, width in (
            ('planned', PLANNED, 7),
            ('driven', DRIVEN, 3),
            ('start', START, 0),
            ('goal, robot was there', REACHED, 0),
            ('goal, replaced or stopped', NOT_REACHED, 0),
        ):
            if width:
                self._draw.line([(x, y), (x + 28, y)], fill=color, width=width)
            else:
                self._disc((x + 14, y), 8, color)
            self._draw.text((x + 36, y), text, fill=INK, font=self._font, anchor='lm')
            x += 36 + self._draw.textlength(text, font=self._font) + 20

    def _disc(self, center: Point, radius: float, color: Color, outline: Color | None = None) -> None:
        x, y = center
        # ImageDraw.circle is not yet in the Pillow of Ubuntu 24.04.
        self._draw.ellipse((x - radius, y - radius, x + radius, y + radius), fill=color, outline=outline, width=2)

    def _pixel(self, point: Point) -> Point:
        return (
            MARGIN + (point[0] - self._origin[0]) * self._scale,
            self._top + self._height - (point[1] - self._origin[1]) * self._scale,
        )
