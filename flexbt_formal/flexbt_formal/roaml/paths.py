# SPDX-License-Identifier: BSD-3-Clause
"""Steps of a model, and whether they have decided a property."""

from __future__ import annotations

from enum import Enum

from .properties import Judge, Property
from .system import GlobalState, ModelSystem, Step


class Order(Enum):
    """In which order automata go on that could at the same time."""

    TURNS = 'turns'
    """What was sent first is delivered first; who has waited longest goes on."""
    RANDOM = 'random'
    """Each with the same probability, as statistical model checkers do."""
    ANY = 'any'
    """All orders: the least or greatest probability of all is asked. Some may starve others."""


class Path:
    """``left`` until ``right``, along the steps of a model."""

    def __init__(self, system: ModelSystem, left: Judge, right: Judge, asked: Property, order: Order) -> None:
        self.system = system
        self.asked = asked
        self.order = order
        self._left = left
        self._right = right
        self.is_bounded = asked.lower > 0 or asked.upper is not None

    def steps(self, state: GlobalState) -> list[Step]:
        """What can happen now, by the order."""
        return self.system.steps(state, first_only=self.order is Order.TURNS)

    def decided(self, state: GlobalState, count: int) -> bool | None:
        """Whether the path is satisfied or not any more; None: it goes on. ``count``: steps up to now."""
        asked = self.asked
        if asked.upper is not None and count > asked.upper:
            return False
        if count >= asked.lower and self._right(state.seen):
            return True
        return None if self._left(state.seen) else False

    def at_end(self, state: GlobalState) -> bool:
        """Whether a path that does not go on is satisfied: it stays as it is for ever."""
        return self.asked.upper is None and self._right(state.seen) and self._left(state.seen)
