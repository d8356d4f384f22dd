# SPDX-License-Identifier: BSD-3-Clause
"""What ``Math.random()`` gives: real numbers by a generator, or all whole numbers that come of it, with their
probabilities, where an expression makes whole numbers of it at once."""

from __future__ import annotations

import math
from collections.abc import Callable
from itertools import pairwise
from typing import Final, Protocol

from .source_text import ModelFault

MOST_VALUES: Final = 20_000
"""Values of one draw that are followed."""


class ManyValuesError(ModelFault):
    """Too many values to follow each of them."""


class Lots(Protocol):
    """What an expression asks by lot; ``u`` is evenly distributed from 0 to below 1."""

    def real(self) -> float:
        """``u``."""

    def whole(self, width: float, least: float) -> int:
        """``floor(least + u * width)``."""

    def below(self, bound: float) -> bool:
        """``u < bound``."""


class Drawn:
    """One value each time."""

    def __init__(self, real: Callable[[], float]) -> None:
        self.real = real

    def whole(self, width: float, least: float) -> int:
        return math.floor(least + self.real() * width)

    def below(self, bound: float) -> bool:
        return self.real() < bound


class AllLots:
    """All values, one set of them after the other: the ``given`` ones first, then the first one of each draw.

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
        first = math.floor(least)
        if width == 0.0:
            return first
        ends = [least, *range(first + 1, math.ceil(least + width)), least + width]
        return first + self._take([(after - before) / width for before, after in pairwise(ends)])

    def below(self, bound: float) -> bool:
        share = min(max(bound, 0.0), 1.0)
        return share > 0.0 and (share >= 1.0 or self._take([share, 1.0 - share]) == 0)

    def _take(self, probabilities: list[float]) -> int:
        place = len(self._made)
        is_new = place >= len(self._given)
        taken = 0 if is_new else self._given[place]
        if is_new:
            self.others += [(*self._made, other) for other in range(1, len(probabilities))]
        self._made.append(taken)
        self.probability *= probabilities[taken]
        return taken
