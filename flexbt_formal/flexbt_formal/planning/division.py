# SPDX-License-Identifier: BSD-3-Clause
"""The division of a plan among the robots of a team, the order of their actions, and its branches."""

from __future__ import annotations

import time
from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass
from typing import Final

from .policy import WAITS, Branch
from .problem import Domain, PlanningError, union
from .relaxation import Reachability
from .search import SearchOutcome, SearchProgress, SearchResult, search


def predecessors(domain: Domain, plan: Sequence[int], doers: Sequence[str]) -> list[int]:
    """Return the predecessors of each index of a plan, as bit sets of indices.

    In each order that respects them, all actions are applicable, and the final state is the same. ``doers`` are the
    robots, by the numbers of actions.
    """
    found = []
    for place, action in enumerate(plan):
        before = 0
        for earlier, other in enumerate(plan[:place]):
            if doers[action] == doers[other] or _depend(domain, action, other):
                before |= 1 << earlier
        found.append(before)
    return found


def ends(domain: Domain, plan: Sequence[int], before: Sequence[int], done: int = 0) -> list[float]:
    """Return the end time of each action of a plan, if costs are durations and each begins as early as possible; 0 for
    those in ``done`` (a bit set of indices)."""
    found: list[float] = []
    for place, action in enumerate(plan):
        if done >> place & 1:
            found.append(0.0)
            continue
        begins = max((end for earlier, end in enumerate(found) if before[place] >> earlier & 1), default=0.0)
        found.append(begins + domain.costs[action])
    return found


def _depend(domain: Domain, one: int, other: int) -> bool:
    """Return whether the order of two actions matters: one changes a need or an effect of the other."""
    return bool(
        domain.adds[one] & domain.needs[other]
        or domain.adds[other] & domain.needs[one]
        or domain.deletes[one] & (domain.needs[other] | domain.adds[other])
        or domain.deletes[other] & (domain.needs[one] | domain.adds[one])
    )


# The assignment of actions to the robots of a team that keeps the total time short.
#
# The cheapest plan may assign all actions to one robot. So the search repeatedly moves an action from the robot that
# ends last to the others, as long as that shortens the plan.


@dataclass(frozen=True, slots=True)
class Division:
    """A plan (numbers of actions, in a possible sequential order) with predecessors and end times.

    ``goal`` is the condition that it reaches; ``before`` and ``ends`` are by index in the plan.
    """

    goal: int
    plan: tuple[int, ...]
    before: tuple[int, ...]
    ends: tuple[float, ...]
    cost: float

    @property
    def duration(self) -> float:
        """Time at which the last robot finishes."""
        return max(self.ends, default=0.0)


@dataclass(frozen=True, slots=True)
class Divided:
    """The best division (None without a plan), and the search for the cheapest plan."""

    division: Division | None
    search: SearchResult
    expanded: int


class Divider:
    """A divider of plans for one goal of a domain, from any state, until the ``deadline`` on the clock. ``doers`` are
    the robots by the numbers of actions, '' for an action that only marks one of the ``goals`` as reached."""

    def __init__(
        self,
        domain: Domain,
        goal: int,
        goals: Sequence[int],
        doers: Sequence[str],
        deadline: float,
        clock: Callable[[], float] = time.perf_counter,
    ) -> None:
        self._domain = domain
        self._goal = goal
        self._goals = tuple(goals)
        self._doers = doers
        self._deadline = deadline
        self._clock = clock
        self._without: frozenset[int] = frozenset()

    def divide(self, state: int, report: Callable[[SearchProgress], None] | None = None) -> Divided:
        """Return the best division found."""
        found = self._search(state, report=report)
        if found.start is None:
            return Divided(None, found, found.expanded)
        best, expanded = self._division(found), found.expanded
        without = frozenset[int]()
        better = True
        while better and self._clock() < self._deadline:
            better = False
            kept = without
            for others in self._left_to_others(best):
                tried = self._search(state, kept | others)
                expanded += tried.expanded
                if (division := self._better(tried, best)) is not None:
                    best, without, better = division, kept | others, True
        self._without = without
        return Divided(best, found, expanded)

    def divide_alike(self, state: int) -> Divided:
        """Return a division that moves the same actions as the last :meth:`divide`, if it beats the cheapest plan."""
        found = self._search(state)
        if found.start is None:
            return Divided(None, found, found.expanded)
        best = self._division(found)
        tried = self._search(state, self._without)
        return Divided(self._better(tried, best) or best, found, found.expanded + tried.expanded)

    def alone(self, robot: str, state: int) -> SearchResult:
        """Return the cheapest plan of one robot."""
        others = [action for action, doer in enumerate(self._doers) if doer not in ('', robot)]
        return self._search(state, others)

    def _search(
        self, state: int, without: Collection[int] = (), report: Callable[[SearchProgress], None] | None = None
    ) -> SearchResult:
        reachability = Reachability(self._domain, state, without)
        limit = self._deadline - self._clock()
        return search(reachability, self._goal, time_limit=limit, report=report, clock=self._clock)

    def _better(self, found: SearchResult, than: Division) -> Division | None:
        """Return the division of a finished search, if it is shorter, or as short and cheaper."""
        if found.outcome is not SearchOutcome.SOLVED:
            return None
        division = self._division(found)
        return division if (division.duration, division.cost) < (than.duration, than.cost) else None

    def _division(self, found: SearchResult) -> Division:
        plan = found.plan()
        goal = self._goals[0]
        if plan and not self._doers[plan[-1]]:
            goal = self._domain.needs[plan.pop()]
        before = predecessors(self._domain, plan, self._doers)
        cost = sum(self._domain.costs[action] for action in plan)
        return Division(goal, tuple(plan), tuple(before), tuple(ends(self._domain, plan, before)), cost)

    def _left_to_others(self, division: Division) -> list[frozenset[int]]:
        """Return the sets of actions to exclude so that the robot that finishes last leaves work to the others: for
        each of its actions, all its actions with the same effect. Each set comes twice: first together with the actions
        by which others could take over the rest of its work."""
        if not division.plan:
            return []
        last = max(range(len(division.plan)), key=division.ends.__getitem__)
        robot = self._doers[division.plan[last]]
        adds = self._domain.adds
        own = [action for action in division.plan if self._doers[action] == robot]
        found: list[frozenset[int]] = []
        for kind in dict.fromkeys(adds[action] for action in reversed(own)):
            left = {one for one, doer in enumerate(self._doers) if doer == robot and adds[one] == kind}
            rest = union(adds[action] for action in own) & ~kind
            taken = {one for one, doer in enumerate(self._doers) if doer not in ('', robot) and adds[one] & rest}
            found += [frozenset(left | taken), frozenset(left)]
        return list(dict.fromkeys(found))


# The action of each robot of a team in each state.
#
# A *branch* is a condition, and for each robot its next action there. The branches cover all orders in which the team
# can carry out a division. Robots that see the same state select the same branch, the first that holds. So no two
# robots do the same action, and they need no negotiation. The actions of a branch do not interfere, and whichever ends
# first leads to a branch with fewer remaining actions. So the team reaches its goal in whatever order the actions
# end.

MOST_ORDERS: Final = 2000
"""Maximum number of partial executions (sets of done actions) of a division. Beyond it, the plan's order is kept."""


def branches_of(domain: Domain, division: Division, robots: Sequence[str], doers: Sequence[str]) -> list[Branch]:
    """Return the branches of a division: one for each set of actions that can be done at some time."""
    plan, before = division.plan, division.before
    whole = (1 << len(plan)) - 1
    own = [[place for place, action in enumerate(plan) if doers[action] == robot] for robot in robots]

    def nexts(done: int) -> list[int]:
        """Return for each robot the index of its next action if it may begin; WAITS otherwise."""
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
    found: list[Branch] = []
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
            Branch(
                conditions[done],
                tuple(plan[one] if one >= 0 else WAITS for one in moments[done]),
                (max(ends(domain, plan, before, done)), sum(domain.costs[one] for one in left), len(left)),
            )
        )
    return found
