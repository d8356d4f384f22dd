# SPDX-License-Identifier: BSD-3-Clause
"""Planning problems: actions and conditions as bit sets, initial state, goal, and the scenes of BTPG.

A *literal* is a text such as ``on(cup, table)``, true or false in a state. A state is the set of literals that are
true; a condition is a set of literals, and holds where all of them are true. An action may run where what it needs
holds, and makes the state ``(state - deletes) | adds``.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import reduce
from operator import or_
from typing import Final

from flexbt_core.errors import FlexbtError
from flexbt_core.values.json_data import load_json
from flexbt_core.values.text import did_you_mean, short_repr

Condition = frozenset[str]
"""Literals that are true at once."""


class PlanningError(FlexbtError):
    """Actions, a state or a goal that cannot be planned with; the text says which, why, and what to do."""


@dataclass(frozen=True, slots=True)
class Action:
    """An action of a plan.

    ``adds`` become true, ``deletes`` false; what is in both becomes true. ``cost`` is at least 0, and of the same unit
    for all actions.
    """

    name: str
    needs: Condition
    adds: Condition
    deletes: Condition
    cost: float = 1.0


class Domain:
    """Actions as bit sets: bit ``i`` of a number stands for ``literals[i]``. ``known`` are literals besides those of
    the actions.

    Raises:
        PlanningError: two actions have one name, or a cost is not a number of at least 0.
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
        """Return the state in which these literals are true. Literals that no action uses are
        omitted."""
        return sum(1 << self._index[literal] for literal in set(true) if literal in self._index)

    def mask(self, condition: Iterable[str]) -> int:
        """Return the bit set of a condition.

        Raises:
            PlanningError: no action knows a literal, nor is it ``known``.
        """
        literals = set(condition)
        for literal in sorted(literals):
            if literal not in self._index:
                raise PlanningError(
                    f'{short_repr(literal)}: no action needs or changes it{did_you_mean(literal, self._index)}'
                )
        return sum(1 << self._index[literal] for literal in literals)

    def condition(self, mask: int) -> Condition:
        """Return the literals of a bit set."""
        return frozenset(self.literals[bit] for bit in bits(mask))

    def result(self, state: int, action: int) -> int:
        """Return the state after an action, by its number."""
        return state & ~self.deletes[action] | self.adds[action]


def union(masks: Iterable[int]) -> int:
    """Return the union of bit sets."""
    return reduce(or_, masks, 0)


def bits(mask: int) -> Iterator[int]:
    """Yield the numbers of the bits that are set, ascending."""
    while mask:
        low = mask & -mask
        yield low.bit_length() - 1
        mask ^= low


# The problem in words: actions, initial state, goal, disturbances, and the leaves that act and test.

_NOT: Final = 'not '
_TYPE: Final = re.compile(r'[^\W\d][\w-]*')
"""Pattern of the names of types: BehaviorTree.CPP 4.8 accepts leaves only as tags of their types."""
_PORT: Final = re.compile(r'(?!(?:name|ID)\Z)[A-Za-z][\w-]*')
"""Pattern of the names of ports: each node has attributes of the others."""
_CALL: Final = re.compile(r'(not )?\s*([^()]+?)\s*(?:\((.*)\))?')


@dataclass(frozen=True, slots=True)
class Leaf:
    """A leaf of a tree: its type and ports. A condition may be ``inverted``. An action has a number of ``attempts``,
    and a ``deadline`` for each (s; None: unlimited)."""

    type: str
    ports: Mapping[str, str] = field(default_factory=dict)
    inverted: bool = False
    attempts: int = 3
    deadline: float | None = None

    @classmethod
    def of(cls, text: str) -> Leaf:
        """Return the default leaf of a literal or an action: ``on(cup, table)`` is a leaf of the type ``on``, with cup
        and table in the ports ``argument1`` and ``argument2``."""
        found = _CALL.fullmatch(text.strip())
        if found is None:
            return cls(text)
        arguments = [one.strip() for one in (found[3] or '').split(',') if one.strip()]
        ports = {f'argument{number}': one for number, one in enumerate(arguments, 1)}
        return cls(found[2], ports, inverted=found[1] is not None)

    def attributes(self, name: str) -> dict[str, str]:
        """Return the attributes of this leaf in XML, as a node of this name.

        Raises:
            PlanningError: XML cannot contain its type or one of its ports.
        """
        for pattern, word in ((_TYPE, self.type), *((_PORT, port) for port in self.ports)):
            if not pattern.fullmatch(word):
                raise PlanningError(
                    f'{name}: {short_repr(word)} cannot be a type or port of a leaf; call it by letters, digits, _ and '
                    '-, and a port neither name nor ID'
                )
        return {'name': name, **self.ports}


@dataclass(frozen=True, slots=True)
class PlanningProblem:
    """A problem to plan for.

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
        """Return the leaf that tests a literal or executes an action."""
        return self.leaves.get(text) or Leaf.of(text)

    def knows(self, text: str) -> bool:
        """Return whether a literal is one of a predicate that is known, or the opposite of one that actions speak
        of."""
        return predicate_of(text) in self.remedies or text.removeprefix(_NOT) in self._literals() - {text}

    def _literals(self) -> Condition:
        """Return the literals of the initial state and of the actions."""
        every = (*self.actions, *self.disturbances)
        return self.initial.union(*(one.needs | one.adds | one.deletes for one in every))


def predicate_of(literal: str) -> str:
    """Return the predicate of a literal: ``on`` for ``on(cup, table)`` and for ``not on(cup, table)``."""
    return literal.removeprefix(_NOT).partition('(')[0]


# The scenes of BTPG (Cai et al., IJCAI 2025) in their published, extracted form: grounded actions with costs.


def read_scene(scene: str, actions: Iterable[str], source: str = '<scene>') -> tuple[tuple[Action, ...], Condition]:
    """Return the actions of a scene, and the literals of its initial state.

    Args:
        scene: JSON with ``initial``, a list of literals.
        actions: lines of JSON with ``name``, ``pre``, ``add``, ``del`` and ``cost``.
        source: named in errors.

    Raises:
        PlanningError: a text is not of this form; names the line.
    """
    try:
        initial = _literals(load_json(scene)['initial'])
    except (ValueError, TypeError, KeyError, RecursionError) as error:
        raise PlanningError(
            f'{source}: no scene of BTPG: expected JSON with a list "initial" ({short_repr(error)})'
        ) from None
    found = []
    for number, line in enumerate(actions, 1):
        try:
            entry = load_json(line)
            effects = {name: _literals(entry[name]) for name in ('pre', 'add', 'del')}
            found.append(
                Action(str(entry['name']), effects['pre'], effects['add'], effects['del'], float(entry['cost']))
            )
        except (ValueError, TypeError, KeyError, OverflowError, RecursionError) as error:
            raise PlanningError(
                f'{source}, action {number}: expected JSON with name, pre, add, del and cost ({short_repr(error)})'
            ) from None
    return tuple(found), initial


def _literals(entry: object) -> Condition:
    if not isinstance(entry, list) or not all(isinstance(one, str) for one in entry):
        raise TypeError(f'{short_repr(entry)} is not a list of literals')
    return frozenset(entry)
