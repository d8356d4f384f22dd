# SPDX-License-Identifier: BSD-3-Clause
"""What a planner plans with: actions over literals (STRIPS), and the same as bit sets.

A *literal* is a text such as ``on(cup, table)``, true or false in a state. A state is the set of literals that are
true; a condition is a set of literals, and holds where all of them are true. An action may run where what it needs
holds, and makes the state ``(state - deletes) | adds``.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Final

from flexbt_core.errors import FlexbtError
from flexbt_core.values import hint, shown

Condition = frozenset[str]
"""Literals that are true at once."""


class PlanningError(FlexbtError):
    """Actions, a state or a goal that cannot be planned with; the text says which, why, and what to do."""


@dataclass(frozen=True, slots=True)
class Action:
    """Something that can be done.

    ``adds`` become true, ``deletes`` false; what is in both becomes true. ``cost`` is at least 0, and of the same unit
    for all actions.
    """

    name: str
    needs: Condition
    adds: Condition
    deletes: Condition
    cost: float = 1.0


class Domain:
    """Actions as bit sets: bit ``i`` of a number stands for ``literals[i]``. ``known`` are literals beside those of
    the actions.

    Raises:
        PlanningError: two actions have one name, or a cost is no number from 0.
    """

    def __init__(self, actions: Iterable[Action], known: Iterable[str] = ()) -> None:
        self.actions: Final = tuple(actions)
        self.literals: Final[list[str]] = []
        self._index: Final[dict[str, int]] = {}
        self.needs: Final[list[int]] = []
        self.adds: Final[list[int]] = []
        self.deletes: Final[list[int]] = []
        self.costs: Final[list[float]] = []
        names: set[str] = set()
        for action in self.actions:
            if action.name in names:
                raise PlanningError(f'action {action.name}: there are two of this name; give one another name')
            names.add(action.name)
            if not 0 <= action.cost < math.inf:
                raise PlanningError(f'action {action.name}: its cost is {action.cost}; it has to be a number from 0')
            self.needs.append(self._mask(action.needs))
            self.adds.append(self._mask(action.adds))
            self.deletes.append(self._mask(action.deletes - action.adds))
            self.costs.append(action.cost)
        self._mask(known)

    def _mask(self, literals: Iterable[str]) -> int:
        mask = 0
        for literal in sorted(literals):  # so that a problem has the same plan in each run
            index = self._index.setdefault(literal, len(self.literals))
            if index == len(self.literals):
                self.literals.append(literal)
            mask |= 1 << index
        return mask

    def state(self, true: Iterable[str]) -> int:
        """The state in which these literals are true. What no action knows makes no difference, and is left out."""
        return sum(1 << self._index[literal] for literal in set(true) if literal in self._index)

    def mask(self, condition: Iterable[str]) -> int:
        """The bit set of a condition.

        Raises:
            PlanningError: no action knows a literal, nor is it ``known``.
        """
        literals = set(condition)
        for literal in sorted(literals):
            if literal not in self._index:
                raise PlanningError(f'{shown(literal)}: no action needs or changes it{hint(literal, self._index)}')
        return sum(1 << self._index[literal] for literal in literals)

    def condition(self, mask: int) -> Condition:
        """The literals of a bit set."""
        return frozenset(self.literals[bit] for bit in bits(mask))

    def result(self, state: int, action: int) -> int:
        """The state after an action, by its number."""
        return state & ~self.deletes[action] | self.adds[action]


def bits(mask: int) -> Iterator[int]:
    """The numbers of the bits that are set, ascending."""
    while mask:
        low = mask & -mask
        yield low.bit_length() - 1
        mask ^= low
