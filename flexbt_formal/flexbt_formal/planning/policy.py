# SPDX-License-Identifier: BSD-3-Clause
"""The branches of a plan in their order, for one robot or several, and the conditions that they share."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Final, NamedTuple

from .problem import Domain, PlanningError

MOST_BRANCHES: Final = 500
"""Maximum number of branches of a tree, besides those of the ways that it needs: a tree of thousands is slow and
unreadable."""

WAITS: Final = -1
"""Stands for the action of a robot that waits while others act."""


class Branch(NamedTuple):
    """A rule: where ``condition`` (a bit set) holds, ``actions`` lead towards the goal: by the number of a robot its
    action, or WAITS. ``left`` are the time, the cost and the number of actions to the goal at most."""

    condition: int
    actions: tuple[int, ...]
    left: tuple[float, float, int]


class Policy:
    """The branches of the trees of some robots, in the order of the time, the cost and the number of actions that are
    left: a tick comes to the first whose condition holds.

    Each branch leads to one of the ``goals`` or to an earlier branch, so from each state in which one holds the goal is
    reached, in as many actions as there are branches at most. Where there are more than MOST_BRANCHES, only those with
    ``needed`` conditions (None: all) are kept.
    """

    def __init__(
        self,
        domain: Domain,
        goals: Iterable[int],
        branches: Iterable[Branch],
        robots: int = 1,
        needed: Collection[int] | None = None,
    ) -> None:
        self.domain: Final = domain
        self.goals: Final = tuple(goals)
        self.branches: Final[list[Branch]] = []
        self._robots = robots
        earlier = list(self.goals)
        for branch in sorted(branches, key=lambda one: one.left):
            if needed is not None and len(self.branches) >= MOST_BRANCHES and branch.condition not in needed:
                continue
            # A tick never reaches a branch that an earlier one covers.
            if not any(not other & ~branch.condition for other in earlier):
                earlier.append(branch.condition)
                self.branches.append(branch)

    @cached_property
    def members(self) -> tuple[tuple[BranchRule | RuleGroup, ...], ...]:
        """Compacted branches of each robot, by its number; where the others continue, its action is WAITS."""
        return tuple(
            compact([BranchRule(one.condition, one.actions[robot], one.left[1]) for one in self.branches])
            for robot in range(self._robots)
        )

    def is_reached(self, state: int) -> bool:
        """Return whether one of the goals holds."""
        return any(not goal & ~state for goal in self.goals)

    def choose(self, state: int) -> Branch | None:
        """Return the branch that a tick selects; None if none holds."""
        return next((branch for branch in self.branches if not branch.condition & ~state), None)

    def actions(self, state: int) -> tuple[int, ...]:
        """Return the actions of the compacted trees in a state; none if no branch holds.

        Raises:
            PlanningError: they differ from the actions of the branches, which is a bug of the planner.
        """
        branch = self.choose(state)
        found = tuple(chosen(members, state) for members in self.members)
        if found != ((None,) * self._robots if branch is None else branch.actions):
            raise PlanningError(fault(self.domain, state, 'its compacted tree chooses something else'))
        return tuple(action for action in found if action is not None and action != WAITS)


def fault(domain: Domain, state: int, what: str) -> str:
    """Return the message of an error of the planner itself."""
    literals = ', '.join(sorted(domain.condition(state)))
    return f'the planner is at fault, please report it: {what}. State: {literals:.2000}'


# Fewer conditions for the same choice: literals that adjacent branches share are tested once.
#
# The order of the branches stays, and with it what is chosen in each state. The saving of a group is what it asks less,
# less the two nodes that it needs (Chen et al., OBTEA, IJCAI 2024, merge adjacent branches pairwise; here the best
# group is taken at each level).

_NODES_OF_GROUP = 2
_LONGEST_GROUP = 64


class BranchRule(NamedTuple):
    """An action of a robot to do where all literals hold: a branch, or the rest of it within a group."""

    condition: int
    action: int
    cost: float


@dataclass(frozen=True, slots=True)
class RuleGroup:
    """Rules and groups, of which the first that applies counts where all literals hold."""

    condition: int
    members: tuple[BranchRule | RuleGroup, ...]


def compact(branches: Sequence[BranchRule]) -> tuple[BranchRule | RuleGroup, ...]:
    """Return branches in their order, with their common literals moved to groups around them."""
    found: list[BranchRule | RuleGroup] = []
    place = 0
    while place < len(branches):
        common, end = _best_group(branches, place)
        if end == place + 1:
            found.append(branches[place])
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


def chosen(members: Sequence[BranchRule | RuleGroup], state: int) -> int | None:
    """Return the action that a tick selects; None if nothing applies."""
    for member in members:
        if member.condition & ~state:
            continue
        if isinstance(member, BranchRule):
            return member.action
        action = chosen(member.members, state)
        if action is not None:
            return action
    return None


def _best_group(branches: Sequence[BranchRule], start: int) -> tuple[int, int]:
    """Return the common literals of the best group of branches that begins at ``start``, and its end."""
    common = branches[start].condition
    best = (0, 0, start + 1)
    for end in range(start + 1, min(len(branches), start + _LONGEST_GROUP)):
        common &= branches[end].condition
        if not common:
            break
        best = max(best, (common.bit_count() * (end - start) - _NODES_OF_GROUP, common, end + 1))
    return best[1], best[2]
