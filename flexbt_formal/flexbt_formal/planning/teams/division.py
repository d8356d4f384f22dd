# SPDX-License-Identifier: BSD-3-Clause
"""Who of a team does what, so that the team is done soon: the cheapest plan, and better ones beside it.

The cheapest plan may leave all to one robot. So whatever the robot that is done last does is left to the others, one
thing after the other, where that makes the whole shorter; until nothing does.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass

from flexbt_formal.planning.backward_search import Outcome, Progress, Reachability, SearchResult, search
from flexbt_formal.planning.problems import Domain

from .order import ends, predecessors


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
        """When the last robot is done."""
        return max(self.ends, default=0.0)


@dataclass(frozen=True, slots=True)
class Divided:
    """The best division (None without a plan), and the search for the cheapest plan."""

    division: Division | None
    search: SearchResult
    expanded: int


class Divider:
    """Divides the ways to one goal of a domain, from any state. ``doers`` are by the numbers of actions, '' for what
    only says that one of the ``goals`` is reached."""

    def __init__(
        self,
        domain: Domain,
        goal: int,
        goals: Sequence[int],
        doers: Sequence[str],
        clock: Callable[[], float] = time.perf_counter,
    ) -> None:
        self._domain = domain
        self._goal = goal
        self._goals = tuple(goals)
        self._doers = doers
        self._clock = clock
        self._without: frozenset[int] = frozenset()

    def divide(self, state: int, deadline: float, report: Callable[[Progress], None] | None = None) -> Divided:
        """The best division that is found until the ``deadline``, on the clock."""
        found = self._search(state, deadline, frozenset(), report)
        if found.start is None:
            return Divided(None, found, found.expanded)
        best, expanded = self._division(found), found.expanded
        without = frozenset[int]()
        better = True
        while better and self._clock() < deadline:
            better = False
            kept = without
            for others in self._left_to_others(best):
                tried = self._search(state, deadline, kept | others)
                expanded += tried.expanded
                if (division := self._better(tried, best)) is not None:
                    best, without, better = division, kept | others, True
        self._without = without
        return Divided(best, found, expanded)

    def divide_alike(self, state: int, deadline: float) -> Divided:
        """As the last :meth:`divide` left things to others, if that is better than the cheapest plan."""
        found = self._search(state, deadline, frozenset())
        if found.start is None:
            return Divided(None, found, found.expanded)
        best = self._division(found)
        tried = self._search(state, deadline, self._without)
        return Divided(self._better(tried, best) or best, found, found.expanded + tried.expanded)

    def alone(self, robot: str, state: int, deadline: float) -> SearchResult:
        """The cheapest plan of one robot."""
        others = [action for action, doer in enumerate(self._doers) if doer not in ('', robot)]
        return self._search(state, deadline, others)

    def _search(
        self,
        state: int,
        deadline: float,
        without: Collection[int],
        report: Callable[[Progress], None] | None = None,
    ) -> SearchResult:
        reachability = Reachability(self._domain, state, without)
        limit = deadline - self._clock()
        return search(reachability, self._goal, time_limit=limit, report=report, clock=self._clock)

    def _better(self, found: SearchResult, than: Division) -> Division | None:
        """The division of a search that is done, if it is shorter, or as short and cheaper."""
        if found.outcome is not Outcome.SOLVED:
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
        """What is not done any more so that the robot that is done last leaves something to the others: of each of its
        actions all that do the same; at first with what would let the others take the rest from it, too."""
        if not division.plan:
            return []
        last = max(range(len(division.plan)), key=division.ends.__getitem__)
        robot = self._doers[division.plan[last]]
        adds = self._domain.adds
        own = [action for action in division.plan if self._doers[action] == robot]
        found: list[frozenset[int]] = []
        for kind in dict.fromkeys(adds[action] for action in reversed(own)):
            left = {one for one, doer in enumerate(self._doers) if doer == robot and adds[one] == kind}
            rest = 0
            for action in own:
                rest |= adds[action] & ~kind
            taken = {one for one, doer in enumerate(self._doers) if doer not in ('', robot) and adds[one] & rest}
            found += [frozenset(left | taken), frozenset(left)]
        return list(dict.fromkeys(found))
