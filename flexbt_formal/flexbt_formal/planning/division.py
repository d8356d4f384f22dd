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
    """For each place of a plan the places that have to be done before, as bit sets.

    In each order that keeps to that, all actions can be done, and the same holds in the end. ``doers`` are by the
    numbers of actions.
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
    """Return when each action of a plan ends, if costs are durations and each begins as soon as it may; 0 for what is
    ``done`` (a bit set of places)."""
    found: list[float] = []
    for place, action in enumerate(plan):
        if done >> place & 1:
            found.append(0.0)
            continue
        begins = max((end for earlier, end in enumerate(found) if before[place] >> earlier & 1), default=0.0)
        found.append(begins + domain.costs[action])
    return found


def _depend(domain: Domain, one: int, other: int) -> bool:
    """Return whether it matters which of two actions comes first: one changes what the other needs or brings about."""
    return bool(
        domain.adds[one] & domain.needs[other]
        or domain.adds[other] & domain.needs[one]
        or domain.deletes[one] & (domain.needs[other] | domain.adds[other])
        or domain.deletes[other] & (domain.needs[one] | domain.adds[one])
    )


# Who of a team does what, so that the team is done soon: the cheapest plan, and better ones beside it.
#
# The cheapest plan may leave all to one robot. So whatever the robot that is done last does is left to the others, one
# thing after the other, where that makes the whole shorter; until nothing does.


@dataclass(frozen=True, slots=True)
class Division:
    """A plan (numbers of actions, in an order in which one could do them all), what waits for what, and ends.

    ``goal`` is the condition to which it leads; ``before`` and ``ends`` are by places of the plan.
    """

    goal: int
    plan: tuple[int, ...]
    before: tuple[int, ...]
    ends: tuple[float, ...]
    cost: float

    @property
    def duration(self) -> float:
        """Time at which the last robot is done."""
        return max(self.ends, default=0.0)


@dataclass(frozen=True, slots=True)
class Divided:
    """The best division (None without a plan), and the search for the cheapest plan."""

    division: Division | None
    search: SearchResult
    expanded: int


class Divider:
    """A divider of the ways to one goal of a domain, from any state, until the ``deadline`` on the clock. ``doers`` are
    by the numbers of actions, '' for one that only says that one of the ``goals`` is reached."""

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
        """Return the best division that is found."""
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
        """As the last :meth:`divide` left things to others, if that is better than the cheapest plan."""
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
        """Return the division of a search that is done, if it is shorter, or as short and cheaper."""
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
        """Return what is not done any more so that the robot that is done last leaves something to the others: of each
        of its actions all that do the same; at first with what would let the others take the rest from it, too."""
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


# What each robot of a team does in which state.
#
# A *branch* is a condition, and for each robot the action with which it may go on there: all orders in which the team
# can carry out a division. Robots that look at the same state find the same branch, the first that holds, so nobody
# does what another one does, and nothing has to be agreed upon. The actions of a branch do not hinder each other, and
# whichever of them ends first leads to a branch with less to do; so the team reaches its goal, in whatever order they
# end.

MOST_ORDERS: Final = 2000
"""Maximum number of orders of one division (what was done until a moment). Beyond it only the plan's order is kept."""


def branches_of(domain: Domain, division: Division, robots: Sequence[str], doers: Sequence[str]) -> list[Branch]:
    """Return the branches of a division: one for each part of it that may be done at a moment."""
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
