# SPDX-License-Identifier: BSD-3-Clause
"""Pictures of a world, and animations of a run."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path
from typing import Final

import numpy
from PIL import Image, ImageDraw

from flexbt_sim.errors import SimulationError
from flexbt_sim.world.devices import Lidar, Scan
from flexbt_sim.world.plane.geometry import Circle, Point, Pose, Shape, compose
from flexbt_sim.world.plane.occupancy_map import UNKNOWN, OccupancyMap

from .scenery import Obstacle
from .world import World

PIXELS: Final = 900
"""Default length of the longer side of a picture, pixels."""

MAX_PIXELS: Final = 8000
MAX_FRAMES: Final = 5000
_FINE: Final = 2
"""Factor by which pictures are drawn larger before they are scaled down, for smooth lines."""

_FONT: Final = 20
_PAD: Final = 4
"""Font size and margin of a text, pixels of the larger picture."""

_ZONES: Final = {'no_go': (214, 69, 65), 'slow': (230, 168, 23), 'sensor_shadow': (120, 90, 170)}
_PAPER: Final = (245, 245, 242)
_ROBOTS: Final = ((0, 122, 135), (196, 78, 22), (85, 107, 47), (125, 60, 152), (30, 90, 180), (150, 40, 80))

Colour = tuple[int, ...]

Paths = Mapping[str, Sequence[Point]]
"""Planned paths by name."""


@dataclass(frozen=True)
class TraceFrame:
    """The moving bodies at a simulated time, s: outlines and poses by name, and scans with their origins."""

    time: float
    bodies: Mapping[str, tuple[Shape, Pose]]
    scans: Mapping[str, tuple[Pose, Scan]]


class Trace:
    """A history of a world: each :meth:`record` adds its current state."""

    def __init__(self, world: World) -> None:
        self._world = world
        self.frames = [frame_of(world)]

    def record(self) -> None:
        """Record the current state of the world.

        Raises:
            SimulationError: the trace has MAX_FRAMES already.
        """
        if len(self.frames) >= MAX_FRAMES:
            raise SimulationError(f'{MAX_FRAMES} frames are the most that a trace has; record less often')
        self.frames.append(frame_of(self._world))

    def driven(self, name: str, until: float = math.inf) -> list[Point]:
        """Return the positions of a body, up to a time, s."""
        seen = (one.bodies[name][1] for one in self.frames if one.time <= until and name in one.bodies)
        return [(pose.x, pose.y) for pose in seen]

    def animate(
        self, file: Path | str, *, speed: float = 10.0, pixels: int = 500, paths: Paths | None = None
    ) -> None:  # fmt: skip
        """Write an animation, GIF or PNG by the suffix of the file, at ``speed`` times the simulated speed.

        Raises:
            SimulationError: the suffix or the size is invalid.
        """
        target = Path(file)
        if target.suffix.lower() not in ('.gif', '.png'):
            raise SimulationError(f'{file}: a moving picture is a .gif or a .png')
        drawing = _Drawing(self._world, pixels, self.frames)
        pictures = [drawing.draw(frame, self, paths or {}) for frame in self.frames]
        span = self.frames[-1].time - self.frames[0].time
        shown = max(20, round(1000.0 * span / max(1, len(pictures) - 1) / speed))
        if target.suffix.lower() == '.gif':
            pictures = [picture.quantize(64, dither=Image.Dither.NONE) for picture in pictures]
        pictures[0].save(target, save_all=True, append_images=pictures[1:], duration=shown, loop=0, optimize=True)


def frame_of(world: World) -> TraceFrame:
    """Return the current state of a world."""
    bodies = {
        name: (body.shape, body.pose)
        for kind in (world.obstacles, world.doors, world.robots)
        for name, body in kind.items()
    }
    scans = {
        name: (compose(robot.pose, lidar.pose), lidar.scan)
        for name, robot in world.robots.items()
        if (lidar := robot.device(Lidar)) is not None and lidar.scan is not None
    }
    return TraceFrame(world.time, bodies, scans)


def draw_world(
    world: World, trace: Trace | None = None, *, paths: Paths | None = None, pixels: int = PIXELS,
    time: float | None = None,
) -> Image.Image:  # fmt: skip
    """Return a picture of a world: map, zones, stations, places, obstacles, doors, robots with footprint, heading and
    scan.

    With a trace, the picture also shows the driven paths up to its time. ``paths`` are planned paths by name, drawn
    dashed. ``pixels`` is the length of the longer side. ``time`` is the time shown in the picture, s, by default that
    of the world.

    Raises:
        SimulationError: the number of pixels is invalid.
    """
    now = frame_of(world)
    drawing = _Drawing(world, pixels, [now, *(trace.frames if trace is not None else ())])
    return drawing.draw(now if time is None else replace(now, time=time), trace, paths or {})


class _Drawing:
    """The static parts of a world, with a scale at which every frame fits into the picture."""

    def __init__(self, world: World, pixels: int, frames: Sequence[TraceFrame]) -> None:
        if not 16 <= pixels <= MAX_PIXELS:
            raise SimulationError(f'a picture of {pixels} pixels; give 16 to {MAX_PIXELS}')
        self._world = world
        points = list(_extent(world, frames))
        self._left, self._top = min(x for x, _ in points), max(y for _, y in points)
        width, height = max(x for x, _ in points) - self._left, self._top - min(y for _, y in points)
        self._scale = _FINE * pixels / max(width, height)
        self._size = max(1, round(width * self._scale)), max(1, round(height * self._scale))
        self._ground = self._draw_ground()

    def _at(self, point: Point) -> Point:
        return (point[0] - self._left) * self._scale, (self._top - point[1]) * self._scale

    def _draw_ground(self) -> Image.Image:
        picture = Image.new('RGB', self._size, _PAPER)
        world = self._world
        if world.map is not None:
            self._paste_map(picture, world.map)
        for zone in world.zones.values():
            layer = Image.new('RGBA', self._size, (0, 0, 0, 0))
            colour = _ZONES[zone.model.kind]
            self._shape(ImageDraw.Draw(layer), zone.model.area, zone.pose, (*colour, 60), (*colour, 200))
            picture.paste(layer, (0, 0), layer)
        pen = ImageDraw.Draw(picture)
        for station in world.stations.values():
            self._shape(pen, Circle(max(0.1, station.model.reach)), station.pose, (200, 232, 200), (40, 140, 60))
            self._heading(pen, station.pose, 0.25, (40, 140, 60))
        for place in world.places.values():
            x, y = self._at((place.x, place.y))
            pen.ellipse((x - 4, y - 4, x + 4, y + 4), fill=(90, 90, 90))
        return picture

    def _paste_map(self, picture: Image.Image, grid: OccupancyMap) -> None:
        grey = numpy.where(grid.cells == UNKNOWN, 205, 255 - grid.cells.astype(int) * 2.2).astype(numpy.uint8)
        cells = Image.fromarray(numpy.ascontiguousarray(grey[::-1]))
        # Transform pixels of the picture to those of the map, which may be rotated.
        cos, sin = math.cos(grid.origin.yaw) / grid.resolution, math.sin(grid.origin.yaw) / grid.resolution
        step, dx, dy = 1.0 / self._scale, self._left - grid.origin.x, self._top - grid.origin.y
        right = (step * cos, -step * sin, dx * cos + dy * sin)
        up = (step * sin, step * cos, grid.height - (dy * cos - dx * sin))
        drawn = cells.convert('RGB').transform(self._size, Image.Transform.AFFINE, (*right, *up), fillcolor=_PAPER)
        picture.paste(drawn)

    def draw(self, frame: TraceFrame, trace: Trace | None, paths: Paths) -> Image.Image:
        picture = self._ground.copy()
        pen = ImageDraw.Draw(picture)
        colours = {name: _ROBOTS[i % len(_ROBOTS)] for i, name in enumerate(self._world.robots)}
        for path in paths.values():
            self._dashes(pen, [self._at(point) for point in path])
        for name, colour in colours.items():
            driven = trace.driven(name, frame.time) if trace is not None else []
            if len(driven) > 1:
                pen.line([self._at(point) for point in driven], fill=colour, width=3, joint='curve')
        for name, (pose, scan) in frame.scans.items():
            self._scan(pen, name, pose, scan)
        for name, (shape, pose) in frame.bodies.items():
            if name in colours:
                self._shape(pen, shape, pose, (*colours[name],), (20, 20, 20))
                self._heading(pen, pose, shape.radius, (255, 255, 255))
            elif isinstance(obstacle := self._world.entities.get(name), Obstacle):
                self._shape(pen, shape, pose, (222, 150, 80) if obstacle.is_mobile else (150, 130, 110), (90, 70, 50))
            else:
                self._shape(pen, shape, pose, (70, 120, 200), (30, 60, 120))
        robots = {name: body for name, body in frame.bodies.items() if name in colours}
        for name, place in self._world.places.items():
            hidden_by = [(shape, pose) for shape, pose in robots.values() if pose.distance(place) < 1.5 * shape.radius]
            if hidden_by:
                shape, pose = hidden_by[0]
                x, y = self._at((pose.x, pose.y - shape.radius))
                self._label(pen, (x, y + 2 * _PAD), 'mt', name)
            else:
                x, y = self._at((place.x, place.y))
                self._label(pen, (x + 2 * _PAD, y - 2 * _PAD), 'lb', name)
        for name, (shape, pose) in robots.items():
            x, y = self._at((pose.x, pose.y + shape.radius))
            self._label(pen, (x, y - 2 * _PAD), 'mb', name, colours[name])
        self._label(pen, (0, 0), 'lt', f'{frame.time:.1f} s')
        return picture.resize((max(1, self._size[0] // _FINE), max(1, self._size[1] // _FINE)), Image.Resampling.BOX)

    def _label(
        self, pen: ImageDraw.ImageDraw, point: Point, anchor: str, text: str, colour: Colour = (90, 90, 90)
    ) -> None:
        """Draw a text on a plate, wholly inside the picture. ``anchor`` as in Pillow."""
        left, top, right, bottom = pen.textbbox(point, text, font_size=_FONT, anchor=anchor)
        dx = max(_PAD - left, min(0.0, self._size[0] - _PAD - right))
        dy = max(_PAD - top, min(0.0, self._size[1] - _PAD - bottom))
        paper = (left + dx - _PAD, top + dy - _PAD, right + dx + _PAD, bottom + dy + _PAD)
        pen.rounded_rectangle(paper, radius=_PAD, fill=(255, 255, 255))
        pen.text((point[0] + dx, point[1] + dy), text, fill=colour, font_size=_FONT, anchor=anchor)

    def _shape(self, pen: ImageDraw.ImageDraw, shape: Shape, pose: Pose, fill: Colour, line: Colour) -> None:
        if isinstance(shape, Circle):
            (x, y), radius = self._at((pose.x, pose.y)), shape.radius * self._scale
            pen.ellipse((x - radius, y - radius, x + radius, y + radius), fill=fill, outline=line, width=2)
        else:
            pen.polygon([self._at(point) for point in shape.points(pose)], fill=fill, outline=line, width=2)

    def _heading(self, pen: ImageDraw.ImageDraw, pose: Pose, length: float, colour: Colour) -> None:
        end = pose.x + 0.9 * length * math.cos(pose.yaw), pose.y + 0.9 * length * math.sin(pose.yaw)
        pen.line([self._at((pose.x, pose.y)), self._at(end)], fill=colour, width=4)

    def _scan(self, pen: ImageDraw.ImageDraw, name: str, pose: Pose, scan: Scan) -> None:
        robot = self._world.robots.get(name)
        if robot is None or robot.model.lidar is None:
            return
        model = robot.model.lidar
        angles = pose.yaw + model.angle_min + numpy.arange(model.beams) * model.angle_increment
        hits = numpy.isfinite(scan.ranges)
        for angle, distance in zip(angles[hits].tolist(), scan.ranges[hits].tolist(), strict=True):
            x, y = self._at((pose.x + distance * math.cos(angle), pose.y + distance * math.sin(angle)))
            pen.rectangle((x - 2, y - 2, x + 1, y + 1), fill=(220, 40, 40))

    def _dashes(self, pen: ImageDraw.ImageDraw, points: Sequence[Point]) -> None:
        """Draw a dashed line, 12 pixels on and 8 off, which continues around corners."""
        travelled = 0.0
        for (x0, y0), (x1, y1) in pairwise(points):
            length = math.hypot(x1 - x0, y1 - y0)
            along = 0.0
            while along < length:
                left = 12.0 - travelled % 20.0 if travelled % 20.0 < 12.0 else 20.0 - travelled % 20.0
                ahead = min(length, along + max(left, 0.01))
                if travelled % 20.0 < 12.0:
                    a, b = along / length, ahead / length
                    ends = [(x0 + part * (x1 - x0), y0 + part * (y1 - y0)) for part in (a, b)]
                    pen.line(ends, fill=(40, 150, 60), width=3)
                travelled += ahead - along
                along = ahead


def _extent(world: World, frames: Sequence[TraceFrame]) -> Iterable[Point]:
    """Return the points that a picture must contain."""
    if world.map is not None:
        grid = world.map
        for row in (-0.5, grid.height - 0.5):
            for column in (-0.5, grid.width - 0.5):
                yield grid.point(row, column)
        return
    areas = [(1.0, Pose(0.0, 0.0, 0.0)), *((1.0, place) for place in world.places.values())]
    areas += [(1.0 + zone.shape.radius, zone.pose) for zone in world.zones.values()]
    areas += [(1.0 + station.shape.radius, station.pose) for station in world.stations.values()]
    areas += [(1.0 + shape.radius, pose) for frame in frames for shape, pose in frame.bodies.values()]
    for margin, (x, y, _) in areas:
        yield x - margin, y - margin
        yield x + margin, y + margin
