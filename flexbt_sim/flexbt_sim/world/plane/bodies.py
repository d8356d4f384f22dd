# SPDX-License-Identifier: BSD-3-Clause
"""What takes up room in the world and may move."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Callable
from typing import Protocol

import numpy

from .geometry import Pose
from .shapes import Shape

At = Callable[[float], Pose]
"""The pose after so many seconds of a movement."""


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
        """What may touch it soon."""

    def reset(self) -> None:
        """As it was at the start."""

    def place(self, pose: Pose) -> None:
        """Put it somewhere, at rest."""
        self.pose = pose

    def tick(self, surroundings: Surroundings, duration: float) -> None:
        """Move for a short time, s. Most things do not."""


class Surroundings(Protocol):
    """The world as its bodies see it."""

    @property
    def time(self) -> float:
        """Simulated time at the start of the tick, s."""

    def advance(self, body: Body, at: At, reach: float, duration: float) -> float:
        """Move a body as far as nothing is in its way; the time, s, that it moved for."""

    def gap_to_bodies(self, body: Body, pose: Pose) -> float:
        """Distance, m, from a body at a pose to the nearest other one."""

    def is_someone_near(self, x: float, y: float, distance: float) -> bool:
        """Whether a robot or a moving obstacle is within a distance, m, of a point."""


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
        """The next number."""
        if not self._block:
            self._block = self._source.standard_normal(256).tolist()
        return self._block.pop()
