# SPDX-License-Identifier: BSD-3-Clause
"""Poses in the plane, and the shapes of bodies: circles and polygons, with gaps and containment."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import Final, NamedTuple

from flexbt_sim.errors import SimulationError

FARTHEST: Final = 1e7
"""Greatest coordinate of a place, m: with greater ones, distances and cells can no longer be computed."""


class Pose(NamedTuple):
    """A position in m and a heading in rad, in the map frame."""

    x: float
    y: float
    yaw: float

    @property
    def is_place(self) -> bool:
        """True if all values are finite and within FARTHEST."""
        return all(map(math.isfinite, self)) and max(abs(self.x), abs(self.y)) <= FARTHEST

    def distance(self, other: Pose) -> float:
        """Return the distance between the positions, m."""
        return math.hypot(other.x - self.x, other.y - self.y)

    def bearing(self, x: float, y: float) -> float:
        """Return the direction of a point relative to the heading, rad in (-pi, pi]."""
        return wrap(math.atan2(y - self.y, x - self.x) - self.yaw)


ORIGIN: Final = Pose(0.0, 0.0, 0.0)


def wrap(angle: float) -> float:
    """Return the same angle in (-pi, pi]."""
    wrapped = math.remainder(angle, math.tau)
    return math.pi if wrapped == -math.pi else wrapped


def drive(pose: Pose, linear: float, angular: float, duration: float) -> Pose:
    """Return the exact pose after driving along an arc at constant speeds (m/s, rad/s) for a time (s)."""
    half = angular * duration / 2.0
    chord = linear * duration * (math.sin(half) / half if half else 1.0)
    return Pose(
        pose.x + chord * math.cos(pose.yaw + half),
        pose.y + chord * math.sin(pose.yaw + half),
        wrap(pose.yaw + 2.0 * half),
    )


def compose(one: Pose, other: Pose) -> Pose:
    """Return ``other``, a pose in the frame of ``one``, in the parent frame of ``one``."""
    cos, sin = math.cos(one.yaw), math.sin(one.yaw)
    return Pose(one.x + other.x * cos - other.y * sin, one.y + other.x * sin + other.y * cos, wrap(one.yaw + other.yaw))


def inverse(pose: Pose) -> Pose:
    """Return the inverse transform: the parent frame of a pose, in the frame of the pose."""
    cos, sin = math.cos(pose.yaw), math.sin(pose.yaw)
    return Pose(-pose.x * cos - pose.y * sin, pose.x * sin - pose.y * cos, wrap(-pose.yaw))


# The areas of bodies in the plane, and the distances between them.

Point = tuple[float, float]
"""A point: x and y, m."""

Segments = list[tuple[float, float, float, float]]
"""Line segments from (x, y) to (x, y), m."""

MAX_CORNERS: Final = 200
LARGEST: Final = 50.0
"""Maximum distance, m, of a point of a shape from its origin."""

SMALLEST: Final = 0.001
"""Minimum radius and side length, m."""


@dataclass(frozen=True)
class Circle:
    """A circle around the origin; ``radius`` in m."""

    radius: float

    def __post_init__(self) -> None:
        if not SMALLEST <= self.radius <= LARGEST:
            raise SimulationError(f'a circle of a radius of {self.radius:g} m; give {SMALLEST:g} to {LARGEST:g}')

    @property
    def turning_radius(self) -> float:
        """Distance from the origin of the farthest point that moves when the shape turns, m: 0 for a circle."""
        return 0.0

    def points(self, pose: Pose) -> list[Point]:
        """Return 64 points on the circle at a pose; their polygon deviates by at most 0.12 %."""
        angles = (math.tau * n / 64.0 for n in range(64))
        return [(pose.x + self.radius * math.cos(a), pose.y + self.radius * math.sin(a)) for a in angles]


@dataclass(frozen=True)
class Polygon:
    """A polygon without holes; ``corners`` in m from the origin, clockwise or counter-clockwise."""

    corners: tuple[Point, ...]

    def __post_init__(self) -> None:
        sides = list(self.sides(Pose(0.0, 0.0, 0.0)))
        if len(sides) < 3:
            raise SimulationError('a polygon has 3 corners or more')
        if far := [corner for corner in self.corners if not math.hypot(*corner) <= LARGEST]:
            x, y = far[0]
            raise SimulationError(
                f'corner ({x:g}, {y:g}) is more than {LARGEST:g} m from the origin: a pose says where that is'
            )
        if any(math.hypot(x1 - x0, y1 - y0) < SMALLEST for x0, y0, x1, y1 in sides):
            raise SimulationError(f'a polygon with a side of less than {SMALLEST:g} m')
        neighbours = {(i, (i + 1) % len(sides)) for i in range(len(sides))}
        for i, one in enumerate(sides):
            for j in range(i + 1, len(sides)):
                if (i, j) not in neighbours and (j, i) not in neighbours and _cross(one, sides[j]):
                    raise SimulationError('a polygon with sides that cross each other; give the corners in their order')

    @cached_property
    def radius(self) -> float:
        """Radius of the circle around the origin that contains the polygon, m."""
        return max(math.hypot(x, y) for x, y in self.corners)

    @property
    def turning_radius(self) -> float:
        """Distance from the origin of the farthest point that moves when the shape turns, m."""
        return self.radius

    def points(self, pose: Pose) -> list[Point]:
        """Return the corners of the polygon at a pose."""
        cos, sin = math.cos(pose.yaw), math.sin(pose.yaw)
        return [(pose.x + x * cos - y * sin, pose.y + x * sin + y * cos) for x, y in self.corners]

    def sides(self, pose: Pose) -> Segments:
        """Return the sides of the polygon at a pose."""
        points = self.points(pose)
        return [(*a, *b) for a, b in pairwise([*points, points[0]])]


Shape = Circle | Polygon


def box(length: float, width: float) -> Polygon:
    """Return a rectangle centred on the origin; ``length`` along x, m. Raises SimulationError for a negative side."""
    if min(length, width) < 0.0:
        raise SimulationError(f'a box of {length:g} x {width:g} m; give positive sides')
    x, y = length / 2.0, width / 2.0
    return Polygon(((x, y), (-x, y), (-x, -y), (x, -y)))


def gap(one: Shape, at: Pose, other: Shape, there: Pose) -> float:
    """Return the distance between two shapes, m; negative if they overlap, and the lower the deeper."""
    if isinstance(one, Circle):
        if isinstance(other, Circle):
            return math.hypot(there.x - at.x, there.y - at.y) - one.radius - other.radius
        return depth(at.x, at.y, other, there) - one.radius
    if isinstance(other, Circle):
        return depth(there.x, there.y, one, at) - other.radius
    return _polygon_gap(one.sides(at), other.sides(there))


def depth(x: float, y: float, polygon: Polygon, pose: Pose) -> float:
    """Return the distance from a point to a polygon, m; inside, the negative distance to its sides."""
    sides = polygon.sides(pose)
    distance = min(_to_segment(x, y, side) for side in sides)
    return -distance if _inside(x, y, sides) else distance


def contains(shape: Shape, pose: Pose, x: float, y: float) -> bool:
    """Return whether a point is in a shape."""
    if isinstance(shape, Circle):
        return math.hypot(x - pose.x, y - pose.y) <= shape.radius
    return math.hypot(x - pose.x, y - pose.y) <= shape.radius and _inside(x, y, shape.sides(pose))


def distance(shape: Shape, pose: Pose, x: float, y: float) -> float:
    """Return the distance from a point to a shape, m; 0 inside."""
    if isinstance(shape, Circle):
        return max(0.0, math.hypot(x - pose.x, y - pose.y) - shape.radius)
    return max(0.0, depth(x, y, shape, pose))


def touches_box(shape: Shape, pose: Pose, low: Point, high: Point) -> bool:
    """Return whether a shape touches a box along the axes, of any size, from its lower left to its upper right end."""
    if isinstance(shape, Circle):
        nearest = (max(least, min(most, at)) for least, most, at in zip(low, high, pose, strict=False))
        return distance(shape, pose, *nearest) == 0.0
    sides = shape.sides(pose)
    return _inside(*low, sides) or any(_is_partly_in_box(side, low, high) for side in sides)


def _is_partly_in_box(side: tuple[float, float, float, float], low: Point, high: Point) -> bool:
    x0, y0, x1, y1 = side
    first, last = 0.0, 1.0
    for start, end, least, most in ((x0, x1, low[0], high[0]), (y0, y1, low[1], high[1])):
        if start != end:
            into, out = sorted(((least - start) / (end - start), (most - start) / (end - start)))
            first, last = max(first, into), min(last, out)
        elif not least <= start <= most:
            return False
    return first <= last


def _polygon_gap(one: Segments, other: Segments) -> float:
    """Return the distance of two polygons, m; if they overlap, the negative distance that one must move to leave the
    hull of the other."""
    overlap = (
        any(_inside(x, y, other) for x, y, *_ in one)
        or any(_inside(x, y, one) for x, y, *_ in other)
        or any(_cross(a, b) for a in one for b in other)
    )
    if overlap:
        return -min(_overlap_across(side, one, other) for side in (*one, *other))
    return min(
        min(_nearest(x, y, other) for x, y, *_ in one),
        min(_nearest(x, y, one) for x, y, *_ in other),
    )


def _overlap_across(side: tuple[float, float, float, float], one: Segments, other: Segments) -> float:
    """Return the overlap of two polygons, m, perpendicular to a side."""
    x0, y0, x1, y1 = side
    length = math.hypot(x1 - x0, y1 - y0)
    ours, theirs = ([(x * (y1 - y0) - y * (x1 - x0)) / length for x, y, *_ in sides] for sides in (one, other))
    return min(max(ours) - min(theirs), max(theirs) - min(ours))


def _nearest(x: float, y: float, sides: Segments) -> float:
    return min(_to_segment(x, y, side) for side in sides)


def _to_segment(x: float, y: float, segment: tuple[float, float, float, float]) -> float:
    x0, y0, x1, y1 = segment
    dx, dy = x1 - x0, y1 - y0
    along = ((x - x0) * dx + (y - y0) * dy) / (dx * dx + dy * dy)
    along = min(1.0, max(0.0, along))
    return math.hypot(x0 + along * dx - x, y0 + along * dy - y)


def _inside(x: float, y: float, sides: Segments) -> bool:
    inside = False
    for x0, y0, x1, y1 in sides:
        if (y0 > y) != (y1 > y) and x < x0 + (y - y0) / (y1 - y0) * (x1 - x0):
            inside = not inside
    return inside


def _cross(a: tuple[float, float, float, float], b: tuple[float, float, float, float]) -> bool:
    return _side(a, b[0], b[1]) != _side(a, b[2], b[3]) and _side(b, a[0], a[1]) != _side(b, a[2], a[3])


def _side(segment: tuple[float, float, float, float], x: float, y: float) -> bool:
    x0, y0, x1, y1 = segment
    return (x1 - x0) * (y - y0) > (y1 - y0) * (x - x0)
