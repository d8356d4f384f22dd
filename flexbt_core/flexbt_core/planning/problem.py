# SPDX-License-Identifier: BSD-3-Clause
"""What is to be planned, in words: actions, where it begins, the goal, what others may do; and how leaves do it."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Final

from .model import Action, Condition, PlanningError

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

    ``goal`` are conditions, one of which has to hold in the end. ``disturbances`` are what others may do while the tree
    runs; their costs say nothing. ``leaves``: for literals and actions (by their names) the leaves of the tree; without
    an entry :meth:`Leaf.of`.

    Raises:
        PlanningError: there is no goal.
    """

    actions: tuple[Action, ...]
    initial: Condition
    goal: tuple[Condition, ...]
    disturbances: tuple[Action, ...] = ()
    leaves: Mapping[str, Leaf] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if not self.goal:
            raise PlanningError('there is no goal; name one, such as on(cup, table) & open(door)')

    def leaf(self, text: str) -> Leaf:
        """How a literal is tested, or an action done."""
        return self.leaves.get(text) or Leaf.of(text)


def parse_goal(text: str) -> tuple[tuple[str, ...], ...]:
    """The literals of a goal: conjunctions with ``&`` (or ``and``), alternatives with ``|`` (or ``or``) between them,
    as ``on(cup, table) & not open(door) | on(mug, table)``.

    Raises:
        PlanningError: a literal is missing, or parentheses do not match.
    """
    parts = re.split(r'(\||&|\bor\b|\band\b)', text)
    if any('(' in part and part.count('(') != part.count(')') for part in parts) or text.count('(') != text.count(')'):
        raise PlanningError(f'goal {text!r:.200}: parentheses do not match, or stand around more than arguments')
    if any(not part.strip() for part in parts[::2]):
        raise PlanningError(
            f'goal {text!r:.200}: a literal is missing; write conditions as on(cup, table) & not open(door), '
            'and alternatives with | between them'
        )
    alternatives: list[list[str]] = [[parts[0].strip()]]
    for operator, literal in zip(parts[1::2], parts[2::2], strict=True):
        if operator in ('|', 'or'):
            alternatives.append([])
        alternatives[-1].append(literal.strip())
    return tuple(map(tuple, alternatives))


def conditions(alternatives: Iterable[Iterable[str]]) -> tuple[Condition, ...]:
    """Alternatives as conditions."""
    return tuple(frozenset(one) for one in alternatives)
