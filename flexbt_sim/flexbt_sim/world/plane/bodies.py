# SPDX-License-Identifier: BSD-3-Clause
"""Bodies that stand or move in the plane, and an index that finds those near a place."""

from __future__ import annotations

import hashlib
import math
from collections import defaultdict
from collections.abc import Callable, Iterable, Iterator
from typing import Final, Protocol

import numpy

from .geometry import Pose, Shape

At = Callable[[float], Pose]
"""A function of the seconds since the start of a movement that returns the pose."""


class Body:
    """Something with a name, a shape and a pose in the world.

    ``top_speed`` is the greatest speed, m/s, that any point of it can have; ``is_mobile`` whether it goes about. At the
    start it has the ``start_shape`` at ``start``.
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
        """Time, s, until which nothing can touch it, wherever it and the others go."""
        self.near: list[Body] = []
        """Bodies that may touch it soon."""

    def reset(self) -> None:
        """Return to the state at the start."""

    def place(self, pose: Pose) -> None:
        """Put it somewhere, at rest."""
        self.pose = pose

    def tick(self, surroundings: WorldView, duration: float) -> None:
        """Move for a short time, s. Most things do not."""


class WorldView(Protocol):
    """The world as its bodies see it."""

    @property
    def time(self) -> float:
        """Simulated time at the start of the tick, s."""

    def advance(self, body: Body, at: At, reach: float, duration: float) -> float:
        """Move a body as far as nothing is in its way; the time, s, that it moved for."""

    def gap_to_bodies(self, body: Body, pose: Pose) -> float:
        """Distance, m, from a body at a pose to the nearest other one."""

    def is_someone_near(self, x: float, y: float, distance: float) -> bool:
        """Return whether a robot or a moving obstacle is within a distance, m, of a point."""


def generator(seed: int, entity: str, source: str) -> numpy.random.Generator:
    """Random numbers of one source of one entity: they depend on nothing else."""
    digest = hashlib.sha256(f'{seed}/{entity}/{source}'.encode()).digest()
    return numpy.random.Generator(numpy.random.PCG64(int.from_bytes(digest[:16], 'little')))


class Normals:
    """Standard normal numbers, one at a time; drawn in blocks, as a call of numpy costs more than a number."""

    def __init__(self, source: numpy.random.Generator) -> None:
        self._source = source
        self._block: list[float] = []

    def next(self) -> float:
        """Return the next number."""
        if not self._block:
            self._block = self._source.standard_normal(256).tolist()
        return self._block.pop()


# Bodies by the squares of the plane that they touch: who is near is found without a look at everybody.

_BLOCK: Final = 2.0
"""Side of the squares, m."""

_LARGE: Final = 20.0
"""Radius, m, from which a body is near to all."""


class BodyGrid:
    """An index of bodies at the places where they were when added, each with a ``margin`` around it, m.

    ``squares`` has those that touch a square by its column and row; ``large`` those that are near to all.
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
        if body.radius > _LARGE:
            self.large.append(body)
            return
        for square in _squares(body.pose.x, body.pose.y, body.radius + self._margin):
            self.squares[square].append(body)

    def remove(self, body: Body) -> None:
        """Remove a body, wherever it is now."""
        at = self._at.pop(body.name)
        if body.radius > _LARGE:
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
        """Return those that may touch a circle, ordered by their names, and others near it."""
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
