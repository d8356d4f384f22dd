# SPDX-License-Identifier: BSD-3-Clause
"""Bodies by the squares of the plane that they touch: who is near is found without a look at everybody."""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Iterable, Iterator
from typing import Final

from .bodies import Body
from .geometry import Pose

_BLOCK: Final = 2.0
"""Side of the squares, m."""

_LARGE: Final = 20.0
"""Radius, m, from which a body is near to all."""


class Blocks:
    """Bodies where they were when that was told, each with a ``margin`` round it, m.

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
        """One more body."""
        self._at[body.name] = body.pose
        if body.radius > _LARGE:
            self.large.append(body)
            return
        for square in _squares(body.pose.x, body.pose.y, body.radius + self._margin):
            self.squares[square].append(body)

    def remove(self, body: Body) -> None:
        """One body less, wherever it is now."""
        at = self._at.pop(body.name)
        if body.radius > _LARGE:
            self.large.remove(body)
            return
        for square in _squares(at.x, at.y, body.radius + self._margin):
            self.squares[square].remove(body)
            if not self.squares[square]:
                del self.squares[square]

    def moved(self, body: Body) -> None:
        """A body may be elsewhere now."""
        if self._at[body.name] != body.pose:
            self.remove(body)
            self.add(body)

    def touching(self, x: float, y: float, radius: float) -> list[Body]:
        """Those that may touch a circle, ordered by their names, and others near it."""
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
