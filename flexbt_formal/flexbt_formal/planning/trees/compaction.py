# SPDX-License-Identifier: BSD-3-Clause
"""Fewer conditions for the same choice: what branches that follow each other have in common is asked once.

The order of the branches stays, and with it what is chosen in each state. The saving of a group is what it asks less,
less the two nodes that it needs (Chen et al., OBTEA, IJCAI 2024, merge adjacent branches pairwise; here the best group
is taken at each level).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Final

from flexbt_formal.planning.problems import PlanningError

from .coverage import fault
from .policy import Branch, Policy

_NODES_OF_GROUP = 2
_LONGEST_GROUP = 64


@dataclass(frozen=True, slots=True)
class Rule:
    """Where all literals hold, an action: a branch, or what is left of it within a group."""

    condition: int
    action: int
    cost: float


@dataclass(frozen=True, slots=True)
class Group:
    """Where all literals hold, the first of some rules and groups that applies."""

    condition: int
    members: tuple[Rule | Group, ...]


def compact(branches: Sequence[Branch]) -> tuple[Rule | Group, ...]:
    """Branches in their order, with what they have in common before them."""
    found: list[Rule | Group] = []
    place = 0
    while place < len(branches):
        common, end = _best_group(branches, place)
        if end == place + 1:
            found.append(Rule(*branches[place]))
        else:
            inner = [branch._replace(condition=branch.condition & ~common) for branch in branches[place:end]]
            found.append(Group(common, compact(inner)))
        place = end
    return tuple(found)


def actions_of(members: Sequence[Rule | Group]) -> tuple[int, ...]:
    """The actions of some branches, each once."""
    return tuple(dict.fromkeys(_actions(members)))


def _actions(members: Sequence[Rule | Group]) -> Iterator[int]:
    for member in members:
        if isinstance(member, Group):
            yield from _actions(member.members)
        else:
            yield member.action


class CompactPolicy:
    """The branches of a policy, compacted, as they are tried.

    Raises:
        PlanningError: on a state in which they choose something else. That is a fault of the planner.
    """

    def __init__(self, policy: Policy) -> None:
        self._policy = policy
        self.domain: Final = policy.domain
        self.members: Final = compact(policy.branches)

    def is_reached(self, state: int) -> bool:
        """Whether one of the goals holds."""
        return self._policy.is_reached(state)

    def actions(self, state: int) -> tuple[int, ...]:
        """The action of the branch that holds; nothing where none does."""
        branch = self._policy.choose(state)
        action = chosen(self.members, state)
        if action != (None if branch is None else branch.action):
            raise PlanningError(fault(self.domain, state, 'its compacted tree chooses something else'))
        return () if action is None else (action,)


def chosen(members: Sequence[Rule | Group], state: int) -> int | None:
    """The action that a tick comes to; None where nothing applies."""
    for member in members:
        if member.condition & ~state:
            continue
        if isinstance(member, Rule):
            return member.action
        action = chosen(member.members, state)
        if action is not None:
            return action
    return None


def _best_group(branches: Sequence[Branch], start: int) -> tuple[int, int]:
    """What the branches of the best group that begins at a place have in common, and its end."""
    common = branches[start].condition
    best = (0, 0, start + 1)
    for end in range(start + 1, min(len(branches), start + _LONGEST_GROUP)):
        common &= branches[end].condition
        if not common:
            break
        best = max(best, (common.bit_count() * (end - start) - _NODES_OF_GROUP, common, end + 1))
    return best[1], best[2]
