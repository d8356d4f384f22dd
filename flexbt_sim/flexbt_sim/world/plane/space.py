# SPDX-License-Identifier: BSD-3-Clause
"""Bodies in the plane, an index of those near a place, their distances to the obstacles of a map, and their movement.

Movement uses conservative advancement. A body moves by its distance to the nearest thing, then measures again, and so
on. So it never jumps over or overlaps anything, at any speed and for any length of the tick. Distances are reused while
they are valid: a body that is far from everything needs no check.
"""

from __future__ import annotations

import hashlib
import math
from collections import defaultdict
from collections.abc import Callable, Collection, Iterable, Iterator
from typing import Final, Protocol

import numpy

from flexbt_sim.errors import SimulationError

from .geometry import FARTHEST, Circle, Polygon, Pose, Shape, compose, contains, gap, inverse, touches_box
from .loops import polygon_gap
from .occupancy_map import OccupancyMap

At = Callable[[float], Pose]
"""A function of the seconds since the start of a movement that returns the pose."""


class Body:
    """Something with a name, a shape and a pose in the world.

    ``top_speed`` is the maximum speed, m/s, of any point of it; ``is_mobile`` is True if it can move. At the start it
    has the ``start_shape`` at ``start``.
    """

    top_speed = 0.0
    is_mobile = False

    def __init__(self, name: str, shape: Shape, pose: Pose) -> None:
        self.name = name
        self.start, self.start_shape = pose, shape
        self.shape = shape
        self.pose = pose
        self.radius = shape.radius
        self.clear_until = -math.inf
        """Time, s, until which nothing can touch it, however it and the others move."""
        self.near: list[Body] = []
        """Bodies that may touch it soon, if it moves by itself."""

    def reset(self) -> None:
        """Return to the state at the start."""

    def place(self, pose: Pose) -> None:
        """Put it at a pose and stop it."""
        self.pose = pose

    def tick(self, surroundings: WorldView, duration: float) -> None:
        """Move for a short time, s; by default, do not move."""


class WorldView(Protocol):
    """The world as its bodies see it."""

    @property
    def time(self) -> float:
        """Simulated time at the start of the tick, s."""

    def advance(self, body: Body, at: At, reach: float, duration: float) -> float:
        """Move a body until something is in its way; return the time, s, that it moved."""

    def gap_to_bodies(self, body: Body, pose: Pose) -> float:
        """Return the distance, m, from a body at a pose to the nearest other body."""

    def is_someone_near(self, x: float, y: float, distance: float) -> bool:
        """Return whether a robot or a moving obstacle is within a distance, m, of a point."""


def generator(seed: int, entity: str, source: str) -> numpy.random.Generator:
    """Return the random numbers for one source of one entity. They depend only on these and the seed."""
    digest = hashlib.sha256(f'{seed}/{entity}/{source}'.encode()).digest()
    return numpy.random.Generator(numpy.random.PCG64(int.from_bytes(digest[:16], 'little')))


class Normals:
    """Standard normal numbers, one at a time. They are drawn in blocks, since a call of numpy costs more than a
    number."""

    def __init__(self, source: numpy.random.Generator) -> None:
        self._source = source
        self._block: list[float] = []

    def next(self) -> float:
        """Return the next number."""
        if not self._block:
            self._block = self._source.standard_normal(256).tolist()
        return self._block.pop()


# Bodies by the squares of the plane that they touch, to find near bodies without checking all of them.

_BLOCK: Final = 2.0
"""Side of the squares, m."""

_LARGE: Final = 20.0
"""Radius with the margin, m, from which a body counts as near to all others."""


class BodyGrid:
    """An index of bodies by their positions when added, each with a ``margin`` around it, m.

    ``squares`` has the bodies that touch a square, by column and row; ``large`` those that count as near to all.
    """

    def __init__(self, bodies: Iterable[Body], margin: float) -> None:
        self._margin = margin
        self._at: dict[str, Pose] = {}
        self.squares: dict[tuple[int, int], list[Body]] = defaultdict(list)
        self.large: list[Body] = []
        for body in bodies:
            self.add(body)

    def add(self, body: Body) -> None:
        """Add a body."""
        self._at[body.name] = body.pose
        if body.radius + self._margin > _LARGE:
            self.large.append(body)
            return
        for square in _squares(body.pose.x, body.pose.y, body.radius + self._margin):
            self.squares[square].append(body)

    def remove(self, body: Body) -> None:
        """Remove a body, even if it has moved."""
        at = self._at.pop(body.name)
        if body.radius + self._margin > _LARGE:
            self.large.remove(body)
            return
        for square in _squares(at.x, at.y, body.radius + self._margin):
            self.squares[square].remove(body)
            if not self.squares[square]:
                del self.squares[square]

    def moved(self, body: Body) -> None:
        """Update the place of a body that may have moved."""
        if self._at[body.name] != body.pose:
            self.remove(body)
            self.add(body)

    def touching(self, x: float, y: float, radius: float) -> list[Body]:
        """Return all bodies that may touch a circle, ordered by name. The result may include others near it."""
        squares: Iterable[tuple[int, int]] = self.squares
        if radius <= _LARGE:
            squares = _squares(x, y, radius)
        found = {body.name: body for square in squares for body in self.squares.get(square, ())}
        found |= {body.name: body for body in self.large}
        return [body for _, body in sorted(found.items())]


def _squares(x: float, y: float, reach: float) -> Iterator[tuple[int, int]]:
    rows = range(math.floor((y - reach) / _BLOCK), math.floor((y + reach) / _BLOCK) + 1)
    for column in range(math.floor((x - reach) / _BLOCK), math.floor((x + reach) / _BLOCK) + 1):
        for row in rows:
            yield column, row


COLLISION_CHECK_DISTANCE: Final = 0.002
"""Distance that a body near an obstacle moves between two collision checks, m."""

_REACH: Final = 1.0
"""Distance, m, within which other bodies are near; more where bodies move by more than a quarter of it in a step."""

ROUNDING: Final = 1e-9
"""Overlap depth, m, that is tolerated."""


class Space:
    """The solid bodies on a map, or on a plane without one. ``time`` and ``until``, s, are those of the tick: its start
    and its end."""

    def __init__(self, world: OccupancyMap | None, step: float) -> None:
        """``step`` is the longest tick, s."""
        self.map = world
        self._step = step
        self._reach = _REACH
        self.time = self.until = 0.0
        self._bodies: dict[str, Body] = {}
        self._mobile: dict[str, Body] = {}
        self._fastest = 0.0
        self._is_changed = False
        self._places = BodyGrid((), 0.0)
        self._have_moved = False
        self._near_since = self._near_until = -math.inf
        if world is not None:
            self._field = world.half_cell_distances
            self._rows, self._columns = 2 * world.height, 2 * world.width
            self._cos, self._sin = math.cos(world.origin.yaw), math.sin(world.origin.yaw)

    def add(self, body: Body) -> None:
        """Add a body."""
        self._bodies[body.name] = body
        if body.is_mobile:
            self._mobile[body.name] = body
        self._places.add(body)
        self.changed()

    def remove(self, body: Body) -> None:
        """Remove a body."""
        del self._bodies[body.name]
        self._mobile.pop(body.name, None)
        self._places.remove(body)
        self.changed()

    def changed(self, *placed: Body) -> None:
        """Handle bodies that were placed: invalidate earlier results."""
        self._is_changed = True
        self._near_until = -math.inf
        for body in placed:
            self._places.moved(body)

    def begin(self, time: float, duration: float) -> None:
        """Begin a tick, in which the bodies move, by its time and duration, s."""
        self.time, self.until = time, time + duration
        self._have_moved = True
        if self._is_changed:
            self._is_changed = False
            self._near_until = -math.inf  # another caller may have updated it meanwhile
            self._fastest = max((body.top_speed for body in self._bodies.values()), default=0.0)
            self._reach = max(_REACH, 4.0 * self._fastest * self._step)
            for body in self._bodies.values():
                body.clear_until = -math.inf

    def touching(self, x: float, y: float, radius: float) -> Iterable[Body]:
        """Return all bodies that may touch a circle, ordered by name. The result may include others near it."""
        if self._have_moved:
            self._have_moved = False
            for body in self._mobile.values():
                self._places.moved(body)
        return self._places.touching(x, y, radius)

    # -- distances ---------------------------------------------------------------------------------------------------

    def gaps(self, body: Body, pose: Pose, overlapped: Collection[Body] = ()) -> list[float]:
        """Return the distances, m, from a body at a pose to the map, to the nearest other body, and to each of the
        ``overlapped`` ones: exact if they are small, otherwise lower bounds.

        Negative where it overlaps something.
        """
        each = [gap(body.shape, pose, other.shape, other.pose) for other in overlapped]
        return [self._gap_to_map(body, pose), self.gap_to_bodies(body, pose, overlapped), *each]

    def gap_to_bodies(self, body: Body, pose: Pose, ignored: Collection[Body] = ()) -> float:
        """Return the distance, m, from a body at a pose to the nearest other one; a lower bound if it is large."""
        if self.time >= self._near_until:
            self._find_near()
        moved = 2.0 * self._fastest * (self.time - self._near_since) if self._fastest else 0.0
        nearest = self._reach - moved
        for other in body.near:
            if other in ignored:
                continue
            there = other.pose
            apart = math.hypot(there.x - pose.x, there.y - pose.y) - body.radius - other.radius
            if apart < nearest:
                both_round = isinstance(body.shape, Circle) and isinstance(other.shape, Circle)
                nearest = min(nearest, apart if both_round else gap(body.shape, pose, other.shape, there))
        return nearest

    def _gap_to_map(self, body: Body, pose: Pose) -> float:
        if self.map is None:
            return math.inf
        shape = body.shape
        room = self._clearance(pose.x, pose.y) - body.radius
        if room > 0.0:
            return room
        if isinstance(shape, Circle):
            return self.map.clearance(pose.x, pose.y) - shape.radius
        room = self._along_sides(shape, pose)
        return room if room > 0.0 else self._exact_gap(shape, pose)

    def _along_sides(self, polygon: Polygon, pose: Pose) -> float:
        """Return a lower bound of the clearance, m, along the sides. Steps are a quarter of a cell or half of the
        clearance there, if that is more."""
        assert self.map is not None
        least = self.map.resolution / 4.0
        nearest = math.inf
        for x0, y0, x1, y1 in polygon.sides(pose):
            length = math.hypot(x1 - x0, y1 - y0)
            room, along = self._clearance(x0, y0), 0.0
            while along < length:
                step = min(max(least, room / 2.0), length - along)
                along += step
                part = along / length
                ahead = self._clearance(x0 + part * (x1 - x0), y0 + part * (y1 - y0))
                nearest = min(
                    nearest, (room + ahead - step) / 2.0
                )  # the clearance changes at most as fast as the position
                room = ahead
        return nearest

    def _exact_gap(self, polygon: Polygon, pose: Pose) -> float:
        """Return the gap, m, between all sides and all near cells of the map."""
        world = self.map
        assert world is not None
        corners = numpy.array([world.grid_position(x, y)[::-1] for x, y in polygon.points(pose)])
        # If no obstacle is near, the surrounding cells are free.
        return min(float(polygon_gap(world.obstacles, corners)), 0.5) * world.resolution

    def _clearance(self, x: float, y: float) -> float:
        """Return a lower bound of the distance, m, from a point to the nearest obstacle of the map, by its nearest grid
        point."""
        world = self.map
        assert world is not None
        dx, dy = x - world.origin.x, y - world.origin.y
        scale = 2.0 / world.resolution
        row, column = (dy * self._cos - dx * self._sin) * scale, (dx * self._cos + dy * self._sin) * scale
        r = min(max(round(row), 0), self._rows)
        c = min(max(round(column), 0), self._columns)
        beside = math.hypot(row - r, column - c) / scale
        room = float(self._field[r, c]) - beside
        # Outside the map, the nearest known point may be far away.
        return world.clearance(x, y) if room < world.resolution < beside else room

    def is_someone_near(self, x: float, y: float, distance: float) -> bool:
        """Return whether a robot or a moving obstacle is within a distance, m, of a point."""
        return any(
            math.hypot(body.pose.x - x, body.pose.y - y) <= distance + body.radius for body in self._mobile.values()
        )

    # -- movement ----------------------------------------------------------------------------------------------------

    def advance(self, body: Body, at: At, reach: float, duration: float) -> float:
        """Move a body along ``at`` and return the time, s, that it moved. No point of it is faster than ``reach``, m/s.

        A body that already overlaps something may move if no overlap grows: one that starts in a wall stops at others.
        """
        if reach == 0.0 or self.until <= body.clear_until:
            body.pose = at(duration)
            return duration
        gone = 0.0
        overlapped: Collection[Body] = ()
        before = self.gaps(body, body.pose)
        if before[1] < 0.0:
            overlapped = [one for one in body.near if gap(body.shape, body.pose, one.shape, one.pose) < 0.0]
            before = self.gaps(body, body.pose, overlapped)
        while True:
            room = min(before)
            if room > reach * (duration - gone):
                body.pose = at(duration)
                body.clear_until = self.time + room / (self._fastest + body.top_speed)
                return duration
            step = min(duration - gone, max(room, COLLISION_CHECK_DISTANCE) / reach)
            ahead = at(gone + step)
            after = self.gaps(body, ahead, overlapped)
            if any(new < min(-ROUNDING, old) for new, old in zip(after, before, strict=True)):
                return gone
            body.pose = ahead
            before, gone = after, gone + step
            if gone >= duration:
                return duration

    # -- near bodies -------------------------------------------------------------------------------------------------

    def _find_near(self) -> None:
        """Find, for each body that moves, those within the reach of it. The result is valid until a body may have moved
        a quarter of that."""
        self._near_since = self.time
        self._near_until = self.time + self._reach / (4.0 * self._fastest) if self._fastest else math.inf
        blocks = BodyGrid(self._bodies.values(), self._reach / 2.0)
        for body in self._bodies.values():
            if body.top_speed:
                near = blocks.touching(body.pose.x, body.pose.y, body.radius + self._reach / 2.0)
                body.near = [other for other in near if other is not body]

    # -- places ------------------------------------------------------------------------------------------------------

    def check(self, body: Body, pose: Pose, others: Iterable[Body], *, on_map: bool) -> None:
        """Check that a body fits at a pose among others and, if requested, on the map outside its obstacles.

        Raises:
            SimulationError: it does not; the message says why.
        """
        place = check_pose(pose)
        for other in others:
            reach = body.radius + other.radius
            if math.hypot(other.pose.x - pose.x, other.pose.y - pose.y) > reach or other is body:
                continue
            if gap(body.shape, pose, other.shape, other.pose) < 0.0:
                raise SimulationError(f"'{body.name}' at {place} would overlap '{other.name}'")
        world = self.map
        if not on_map or world is None:
            return
        self.check_on_map(pose)
        if self._gap_to_map(body, pose) < 0.0 or self._covers_obstacle(body, pose):
            raise SimulationError(
                f"{place} is {world.clearance(pose.x, pose.y):.2f} m from an obstacle, and '{body.name}' has a radius "
                f'of {body.radius:g} m'
            )

    def check_on_map(self, pose: Pose, shape: Shape | None = None) -> None:
        """Check that a place, or part of a shape there, is on the map, if there is one.

        Raises:
            SimulationError: it is not.
        """
        world, place = self.map, check_pose(pose)
        if world is None:
            return
        width, height = world.width * world.resolution, world.height * world.resolution
        if shape is None:
            on_map = world.contains(*world.cell(pose.x, pose.y))
        else:
            on_map = touches_box(shape, compose(inverse(world.origin), pose), (0.0, 0.0), (width, height))
        if not on_map:
            raise SimulationError(
                f'{place} is outside of the map of {width:g} x {height:g} m with its corner at '
                f'({world.origin.x:g}, {world.origin.y:g})'
            )

    def _covers_obstacle(self, body: Body, pose: Pose) -> bool:
        """Return whether an obstacle of the map is inside a polygon without touching its sides."""
        world = self.map
        if world is None or isinstance(body.shape, Circle):
            return False
        row, column = world.cell(pose.x, pose.y)
        reach = math.ceil(body.radius / world.resolution) + 1
        bottom, left = max(0, row - reach), max(0, column - reach)
        cells = numpy.argwhere(world.obstacles[bottom : row + reach + 1, left : column + reach + 1])
        return any(contains(body.shape, pose, *world.point(bottom + r, left + c)) for r, c in cells.tolist())


def check_pose(pose: Pose) -> str:
    """Return the pose as text.

    Raises:
        SimulationError: it is not a valid pose.
    """
    place = f'({pose.x:g}, {pose.y:g}, {pose.yaw:g})'
    if not pose.is_place:
        raise SimulationError(f'{place} is not a pose; give finite numbers, of at most {FARTHEST:g}: m, m, rad')
    return place
