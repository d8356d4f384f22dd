# SPDX-License-Identifier: BSD-3-Clause
"""Values of ``Math.random()``: real numbers by a generator, or all whole numbers that come of it, with their
probabilities, where an expression makes whole numbers of it at once."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Final

from .source_text import ModelFault

MOST_VALUES: Final = 20_000
"""Values of one draw that are followed."""


class ManyValuesError(ModelFault):
    """Too many values to follow each of them."""


class SampledDraws:
    """Random draws of expressions, by a generator: ``u`` is evenly distributed from 0 to below 1."""

    def __init__(self, real: Callable[[], float]) -> None:
        self.real = real

    def whole(self, width: float, least: float) -> int:
        """Return ``floor(least + u * width)``."""
        return math.floor(least + self.real() * width)

    def below(self, bound: float) -> bool:
        """Return whether ``u < bound``."""
        return self.real() < bound


class EnumeratedDraws:
    """The same draws, for all values, one set after the other: the ``given`` ones first, then the first one of each.

    ``probability`` is that of the set, ``others`` are the sets beside it.
    """

    def __init__(self, given: tuple[int, ...] = ()) -> None:
        self._given = given
        self._made: list[int] = []
        self.probability = 1.0
        self.others: list[tuple[int, ...]] = []

    def real(self) -> float:
        raise ManyValuesError('the model uses Math.random for real numbers, whose values are too many to follow')

    def whole(self, width: float, least: float) -> int:
        if not 0.0 <= width <= MOST_VALUES:
            raise ManyValuesError(f'Math.random() * {width:g} has too many values to follow each, or is negative')
        first, most = math.floor(least), least + width
        last = math.ceil(most) - first - 1
        if last < 1:
            return first
        taken = self._take(last + 1)
        begin = first + taken if taken else least
        end = first + taken + 1 if taken < last else most
        # Not by the width: of a small one a part is rounded away when it is added.
        self.probability *= (end - begin) / (most - least)
        return first + taken

    def below(self, bound: float) -> bool:
        if not bound > 0.0:  # not a number, maybe
            return False
        if bound >= 1.0:
            return True
        is_below = self._take(2) == 0
        self.probability *= bound if is_below else 1.0 - bound
        return is_below

    def _take(self, count: int) -> int:
        """Return which of this many values it is in this set."""
        place = len(self._made)
        if place >= len(self._given):
            self.others += [(*self._made, other) for other in range(1, count)]
            self._made.append(0)
        else:
            self._made.append(self._given[place])
        return self._made[-1]


Draws = SampledDraws | EnumeratedDraws
