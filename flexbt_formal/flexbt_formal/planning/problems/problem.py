# SPDX-License-Identifier: BSD-3-Clause
"""What is to be planned, in words: actions, where it begins, the goal, what others may do; and how leaves do it."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Final

from .model import Action, Condition, PlanningError

_NOT: Final = 'not '
_CALL: Final = re.compile(r'(not )?\s*([^()]+?)\s*(?:\((.*)\))?')


@dataclass(frozen=True, slots=True)
class Leaf:
    """A node of a tree: its type and ports. Of a condition, whether its result is ``inverted``; of an action, how often
    it is tried (``attempts``), and how long each time (``deadline``, s; None: as long as it takes)."""

    type: str
    ports: Mapping[str, str] = field(default_factory=dict)
    inverted: bool = False
    attempts: int = 3
    deadline: float | None = None

    @classmethod
    def of(cls, text: str) -> Leaf:
        """The leaf for a literal or an action of which nothing else is said: ``on(cup, table)`` is a leaf of the type
        ``on``, whose ports ``argument1`` and ``argument2`` are cup and table."""
        found = _CALL.fullmatch(text.strip())
        if found is None:
            return cls(text)
        arguments = [one.strip() for one in (found[3] or '').split(',') if one.strip()]
        ports = {f'argument{number}': one for number, one in enumerate(arguments, 1)}
        return cls(found[2], ports, inverted=found[1] is not None)


@dataclass(frozen=True, slots=True)
class Problem:
    """What is to be planned.

    ``goal`` are conditions, one of which has to hold in the end. Where it asks for ``not X``, and the actions speak of
    X only, they and the initial state are completed by what becomes of ``not X``. ``disturbances`` are what others may
    do while the tree runs; their costs say nothing. ``leaves``: for literals and actions (by their names) the leaves of
    the tree; without an entry :meth:`Leaf.of`. ``remedies``: for predicates what may be missing where no action brings
    one of their literals about, or ''; of other predicates, a literal that no action knows is taken for a slip.

    Raises:
        PlanningError: there is no goal.
    """

    actions: tuple[Action, ...]
    initial: Condition
    goal: tuple[Condition, ...]
    disturbances: tuple[Action, ...] = ()
    leaves: Mapping[str, Leaf] = field(default_factory=dict)
    remedies: Mapping[str, str] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if not self.goal:
            raise PlanningError('there is no goal; name one, such as on(cup, table) & open(door)')
        known = self._literals()
        asked = frozenset[str]().union(*self.goal) - known
        opposites = {one.removeprefix(_NOT): one for one in asked if one.removeprefix(_NOT) in known}
        if not opposites:
            return

        def opposite(literals: Condition) -> Condition:
            return frozenset(opposites[one] for one in literals & opposites.keys())

        def completed(one: Action) -> Action:
            adds, deletes = one.adds | opposite(one.deletes - one.adds), one.deletes | opposite(one.adds)
            return replace(one, adds=adds, deletes=deletes)

        object.__setattr__(self, 'actions', tuple(map(completed, self.actions)))
        object.__setattr__(self, 'disturbances', tuple(map(completed, self.disturbances)))
        object.__setattr__(self, 'initial', self.initial | opposite(frozenset(opposites) - self.initial))

    def leaf(self, text: str) -> Leaf:
        """How a literal is tested, or an action done."""
        return self.leaves.get(text) or Leaf.of(text)

    def knows(self, text: str) -> bool:
        """Whether a literal is one of a predicate that is known, or the opposite of one that actions speak of."""
        return predicate_of(text) in self.remedies or text.removeprefix(_NOT) in self._literals() - {text}

    def _literals(self) -> Condition:
        """What holds at the start, and all that actions speak of."""
        every = (*self.actions, *self.disturbances)
        return self.initial.union(*(one.needs | one.adds | one.deletes for one in every))


def predicate_of(literal: str) -> str:
    """The predicate of a literal as it is written: on, of ``on(cup, table)`` and of ``not on(cup, table)``."""
    return literal.removeprefix(_NOT).partition('(')[0]
