# SPDX-License-Identifier: BSD-3-Clause
"""The branches of a plan in their order, and the conditions that they share."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Final, NamedTuple

from .coverage import fault
from .problem import Domain, PlanningError
from .search import RegressionStep

MOST_BRANCHES: Final = 500
"""Maximum number of branches of a tree, besides those of the ways that it needs: a tree of thousands is slow and
unreadable."""


class Branch(NamedTuple):
    """A rule: where ``condition`` (a bit set) holds, do ``action``; the goal is then reached at ``cost`` at most."""

    condition: int
    action: int
    cost: float


class Policy:
    """The branches of a tree that ticks them in their order: the first whose condition holds is the cheapest way known.

    Each branch leads to the goal or to an earlier branch, so from each state in which one holds the goal is reached, in
    as many actions as there are branches at most.

    Of the conditions ``goals`` one has to hold in the end. ``steps`` are as a search leaves them: the ``next`` of each
    is among them or a goal. Of the conditions ``starts`` each has its branch, and so have all on the way from there to
    the goal; of the others the MOST_BRANCHES cheapest have one.
    """

    def __init__(
        self, domain: Domain, goals: Iterable[int], steps: Mapping[int, RegressionStep], starts: Iterable[int]
    ) -> None:
        self.domain: Final = domain
        self.goals: Final = tuple(goals)
        self.steps: Final = dict(steps)
        self.starts: Final = frozenset(starts)
        self.branches: Final[list[Branch]] = []
        needed = {condition for start in self.starts for condition in self._way(start)}
        earlier = list(self.goals)
        for condition, step in sorted(self.steps.items(), key=lambda item: (item[1].cost, len(self._way(item[0])))):
            if len(self.branches) >= MOST_BRANCHES and condition not in needed:
                continue
            # What an earlier one covers is never come to.
            if step.action is not None and not any(not other & ~condition for other in earlier):
                earlier.append(condition)
                self.branches.append(Branch(condition, step.action, step.cost))

    def _way(self, condition: int) -> list[int]:
        """Return the conditions from one to the goal."""
        way = [condition]
        while (step := self.steps[way[-1]]).action is not None:
            way.append(step.next)
        return way

    def is_reached(self, state: int) -> bool:
        """Return whether one of the goals holds."""
        return any(not goal & ~state for goal in self.goals)

    def choose(self, state: int) -> Branch | None:
        """Return the branch that a tick comes to; None where none holds."""
        return next((branch for branch in self.branches if not branch.condition & ~state), None)

    def merged(self, other: Policy) -> Policy:
        """Return this policy with the steps of another one; of two steps for one condition the cheaper."""
        both = dict(self.steps)
        for condition, step in other.steps.items():
            if condition not in both or step.cost < both[condition].cost:
                both[condition] = step
        return Policy(self.domain, self.goals, both, self.starts | other.starts)


# Fewer conditions for the same choice: what branches that follow each other have in common is asked once.
#
# The order of the branches stays, and with it what is chosen in each state. The saving of a group is what it asks less,
# less the two nodes that it needs (Chen et al., OBTEA, IJCAI 2024, merge adjacent branches pairwise; here the best
# group is taken at each level).

_NODES_OF_GROUP = 2
_LONGEST_GROUP = 64


@dataclass(frozen=True, slots=True)
class BranchRule:
    """An action to do where all literals hold: a branch, or the rest of it within a group."""

    condition: int
    action: int
    cost: float


@dataclass(frozen=True, slots=True)
class RuleGroup:
    """Rules and groups, of which the first that applies counts where all literals hold."""

    condition: int
    members: tuple[BranchRule | RuleGroup, ...]


def compact(branches: Sequence[Branch]) -> tuple[BranchRule | RuleGroup, ...]:
    """Branches in their order, with what they have in common before them."""
    found: list[BranchRule | RuleGroup] = []
    place = 0
    while place < len(branches):
        common, end = _best_group(branches, place)
        if end == place + 1:
            found.append(BranchRule(*branches[place]))
        else:
            inner = [branch._replace(condition=branch.condition & ~common) for branch in branches[place:end]]
            found.append(RuleGroup(common, compact(inner)))
        place = end
    return tuple(found)


def actions_of(members: Sequence[BranchRule | RuleGroup]) -> tuple[int, ...]:
    """Return the actions of some branches, each once."""
    return tuple(dict.fromkeys(_actions(members)))


def _actions(members: Sequence[BranchRule | RuleGroup]) -> Iterator[int]:
    for member in members:
        if isinstance(member, RuleGroup):
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
        """Return whether one of the goals holds."""
        return self._policy.is_reached(state)

    def actions(self, state: int) -> tuple[int, ...]:
        """Return the action of the branch that holds; nothing where none does."""
        branch = self._policy.choose(state)
        action = chosen(self.members, state)
        if action != (None if branch is None else branch.action):
            raise PlanningError(fault(self.domain, state, 'its compacted tree chooses something else'))
        return () if action is None else (action,)


def chosen(members: Sequence[BranchRule | RuleGroup], state: int) -> int | None:
    """Return the action that a tick comes to; None where nothing applies."""
    for member in members:
        if member.condition & ~state:
            continue
        if isinstance(member, BranchRule):
            return member.action
        action = chosen(member.members, state)
        if action is not None:
            return action
    return None


def _best_group(branches: Sequence[Branch], start: int) -> tuple[int, int]:
    """Return what the branches of the best group that begins at a place have in common, and its end."""
    common = branches[start].condition
    best = (0, 0, start + 1)
    for end in range(start + 1, min(len(branches), start + _LONGEST_GROUP)):
        common &= branches[end].condition
        if not common:
            break
        best = max(best, (common.bit_count() * (end - start) - _NODES_OF_GROUP, common, end + 1))
    return best[1], best[2]
