# SPDX-License-Identifier: BSD-3-Clause
"""What each robot of a team does in which state.

A *branch* is a condition, and for each robot the action with which it may go on there: all orders in which the team can
carry out a division. Robots that look at the same state find the same branch, the first that holds, so nobody does what
another one does, and nothing has to be agreed upon. The actions of a branch do not hinder each other, and whichever of
them ends first leads to a branch with less to do; so the team reaches its goal, in whatever order they end.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Final, NamedTuple

from flexbt_formal.planning.problems import Domain, PlanningError
from flexbt_formal.planning.trees import Branch, chosen, compact, fault

from .division import Division
from .order import ends

MOST_ORDERS: Final = 2000
"""Of one division: what was done until a moment. Beyond that only the order of its plan is kept."""

WAITS: Final = -1
"""In the place of an action: others go on from here."""


class TeamBranch(NamedTuple):
    """Where ``condition`` (a bit set) holds, ``actions`` bring nearer to the goal: by the number of a robot its action,
    or WAITS. ``left`` are the time, the cost and the number of actions to the goal."""

    condition: int
    actions: tuple[int, ...]
    left: tuple[float, float, int]


class TeamPolicy:
    """The branches of a team, in the order of the time, the cost and the number of actions that are left."""

    def __init__(
        self, domain: Domain, goals: Iterable[int], robots: Sequence[str], branches: Iterable[TeamBranch]
    ) -> None:
        self.domain: Final = domain
        self.goals: Final = tuple(goals)
        self.robots: Final = tuple(robots)
        self.branches: Final[list[TeamBranch]] = []
        earlier = list(self.goals)
        for branch in sorted(branches, key=lambda one: one.left):
            # What an earlier one covers is never come to.
            if not any(not other & ~branch.condition for other in earlier):
                earlier.append(branch.condition)
                self.branches.append(branch)
        self.members: Final = tuple(
            compact([Branch(one.condition, one.actions[robot], one.left[1]) for one in self.branches])
            for robot in range(len(self.robots))
        )
        """By the number of a robot its branches, compacted; where others go on, its action is WAITS."""

    def is_reached(self, state: int) -> bool:
        """Whether one of the goals holds."""
        return any(not goal & ~state for goal in self.goals)

    def choose(self, state: int) -> TeamBranch | None:
        """The branch that a tick comes to; None where none holds."""
        return next((branch for branch in self.branches if not branch.condition & ~state), None)

    def actions(self, state: int) -> tuple[int, ...]:
        """What the trees of the robots do in a state; nothing where no branch holds.

        Raises:
            PlanningError: they do something else than the branches say. That is a fault of the planner.
        """
        branch = self.choose(state)
        found = tuple(chosen(members, state) for members in self.members)
        if found != ((None,) * len(self.robots) if branch is None else branch.actions):
            raise PlanningError(fault(self.domain, state, 'its compacted trees choose something else'))
        return tuple(action for action in found if action is not None and action >= 0)


def branches_of(domain: Domain, division: Division, robots: Sequence[str], doers: Sequence[str]) -> list[TeamBranch]:
    """The branches of a division: one for whatever may be done of it at a moment."""
    plan, before = division.plan, division.before
    whole = (1 << len(plan)) - 1
    own = [[place for place, action in enumerate(plan) if doers[action] == robot] for robot in robots]

    def nexts(done: int) -> list[int]:
        """By robot the place of its next action if it may begin; WAITS otherwise."""
        found = []
        for places in own:
            place = next((one for one in places if not done >> one & 1), WAITS)
            found.append(place if place >= 0 and not before[place] & ~done else WAITS)
        return found

    moments = {0: nexts(0)}
    todo = [0]
    while todo and len(moments) <= MOST_ORDERS:
        done = todo.pop()
        for place in moments[done]:
            after = done | 1 << place if place >= 0 else done
            if after not in moments:
                moments[after] = nexts(after)
                todo.append(after)
    if todo:
        moments = {}
        for place in range(len(plan) + 1):
            done = (1 << place) - 1
            moments[done] = [one if one == place else WAITS for one in nexts(done)]
    conditions = {whole: division.goal}
    found: list[TeamBranch] = []
    for done in sorted(moments, key=int.bit_count, reverse=True):
        if done == whole:
            continue
        place = next(one for one in moments[done] if one >= 0)
        after, action = conditions[done | 1 << place], plan[place]
        if after & domain.deletes[action]:
            raise PlanningError('the planner is at fault, please report it: an action undoes what it is to lead to')
        conditions[done] = domain.needs[action] | after & ~domain.adds[action]
        left = [one for number, one in enumerate(plan) if not done >> number & 1]
        found.append(
            TeamBranch(
                conditions[done],
                tuple(plan[one] if one >= 0 else WAITS for one in moments[done]),
                (max(ends(domain, plan, before, done)), sum(domain.costs[one] for one in left), len(left)),
            )
        )
    return found
