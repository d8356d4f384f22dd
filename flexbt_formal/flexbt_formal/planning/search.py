# SPDX-License-Identifier: BSD-3-Clause
"""Backward search for the cheapest plan: A* over conditions, as OBTEA (Chen et al., IJCAI 2024) with a lower bound.

A condition c is regressed through an action a that makes a part of it true and no part false: where
``needs(a) | (c - adds(a))`` holds, a leads to c. The search is *sound* (each condition leads to the goal by its
actions), *complete* (on the declared model), and *optimal*: it expands conditions by cost so far plus a lower bound of
the rest, and the first one that holds in the initial state is on a cheapest plan.

In addition to LM-cut, three methods make it fast:

- Partial expansion: a condition is regressed only through actions of plans within its current bound. It returns to the
  queue with the next higher bound.
- Pruning: the search drops conditions with two literals that exclude each other, and conditions that contain another
  condition of the same or a lower cost.
- Lazy cuts: the cuts of a condition are completed only before its expansion. Until then it uses the cuts of its
  successor.
"""

from __future__ import annotations

import heapq
import math
import time
from bisect import bisect_right
from collections import defaultdict
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from enum import Enum
from typing import Final, NamedTuple

from .problem import bits, union
from .relaxation import Cuts, LmCut, Reachability, total

_REPORT_INTERVAL: Final = 0.2


class SearchOutcome(Enum):
    """The outcome of a search."""

    SOLVED = 'solved'
    UNSOLVABLE = 'unsolvable'
    TIME_LIMIT = 'time limit'


class SearchProgress(NamedTuple):
    """Progress of a search: no plan is cheaper than ``bound``; ``best`` is the cost of the best plan so far, or
    None."""

    bound: float
    best: float | None
    expanded: int
    seconds: float


class RegressionStep(NamedTuple):
    """A step from a known condition to the goal at ``cost``: ``action`` (None at the goal) leads to condition
    ``next``."""

    cost: float
    action: int | None
    next: int


@dataclass(slots=True)
class SearchResult:
    """The result of a search.

    ``steps``: the step of each expanded condition. ``start``: the condition of the best plan that holds at the start,
    None without a plan. ``bound``: no plan is cheaper. ``expanded``: number of expanded conditions.
    """

    outcome: SearchOutcome
    bound: float
    steps: dict[int, RegressionStep] = field(repr=False)
    start: int | None = None
    expanded: int = 0
    seconds: float = 0.0

    @property
    def cost(self) -> float | None:
        """Cost of the best plan that was found."""
        return None if self.start is None else self.steps[self.start].cost

    def plan(self) -> list[int]:
        """Return the actions of the best plan that was found; empty without one."""
        actions = []
        condition = self.start
        while condition is not None and (step := self.steps[condition]).action is not None:
            actions.append(step.action)
            condition = step.next
        return actions


def search(
    reachability: Reachability,
    goal: int,
    *,
    time_limit: float = math.inf,
    report: Callable[[SearchProgress], None] | None = None,
    clock: Callable[[], float] = time.perf_counter,
) -> SearchResult:
    """Return the cheapest plan from the initial state to a goal (a bit set).

    End with ``TIME_LIMIT`` after ``time_limit`` (seconds on the ``clock``); the result then contains the best plan so
    far.
    After half of that time, the search prefers to find any plan first. ``report`` is called about five times a second.
    """
    return _Search(reachability, goal, time_limit, report, clock).run()


class _Search:
    def __init__(
        self,
        reachability: Reachability,
        goal: int,
        time_limit: float,
        report: Callable[[SearchProgress], None] | None,
        clock: Callable[[], float],
    ) -> None:
        self._clock = clock
        self._began = self._now = clock()
        self._deadline = self._began + time_limit
        self._hurry = self._began + time_limit / 2
        self._report = report
        self._reported = self._began
        self._reachability = reachability
        self._lm_cut: Final = LmCut(reachability)
        self._goal = goal
        self._unreachable: Final = sum(1 << at for at, one in enumerate(reachability.costs) if one == math.inf)
        cuts = () if goal & self._unreachable else self._lm_cut.cuts(goal)
        self._cuts: Final[dict[int, Cuts]] = {goal: cuts}
        self._least: Final = math.inf if goal & self._unreachable else total(cuts)
        self._taken: Final[dict[int, float]] = defaultdict(float)
        for cut in cuts:
            for action in cut.actions:
                self._taken[action] += cut.cost
        self._reductions: Final[dict[int, float]] = {}
        domain = reachability.domain
        for action, taken in self._taken.items():
            for literal in bits(domain.adds[action]):
                reduction = min(reachability.weights[literal], taken)
                self._reductions[literal] = max(self._reductions.get(literal, 0.0), reduction)
        self._reduced = sum(1 << literal for literal in self._reductions)
        self._achievers: Final[dict[int, tuple[list[float], list[int]]]] = {}
        self._excluded_before: Final[dict[int, int]] = {}
        self._of: Final = reachability.exclusions.of

    def run(self) -> SearchResult:
        reachability, goal, least = self._reachability, self._goal, self._least
        initial = reachability.initial
        steps = {goal: RegressionStep(0.0, None, goal)}
        result = SearchResult(SearchOutcome.UNSOLVABLE, least, steps)
        impossible = least == math.inf or reachability.exclusions.excluded(goal)
        queue = _Queue()
        if not impossible:
            queue.push(_Open(least, least, goal, 0.0, -math.inf))
        closed = _Closed()
        best: tuple[float, int] = (math.inf, goal)
        while queue:
            queue.take_nearest(best[0] == math.inf and self._now >= self._hurry)
            bound, _, condition, cost, done = queue.pop()
            if cost > steps[condition].cost:
                continue
            if not queue.nearest_first:
                result.bound = bound
            if not condition & ~initial:
                result.outcome = SearchOutcome.SOLVED
                best = (cost, condition)
                break
            if self._is_over(result, best[0]):
                result.outcome = SearchOutcome.TIME_LIMIT
                break
            if done == -math.inf:
                if closed.covers(condition, cost):
                    continue
                rest = self._rest(condition, steps[condition].next)
                if cost + rest > bound:
                    queue.push(_Open(cost + rest, rest, condition, cost, -math.inf))
                    continue
                closed.add(condition, cost)
                result.expanded += 1
            cuts = self._cuts[condition]
            up_to = math.inf if queue.nearest_first else bound
            for before, step in self._regressions(condition, cost, done, up_to):
                known = steps.get(before)
                if before & self._unreachable or (known is not None and known.cost <= step.cost):
                    continue
                steps[before] = step
                if not before & ~initial:
                    best = min(best, (step.cost, before))
                rest = max(total(self._cuts.get(before) or self._lm_cut.kept(before, cuts)), bound - step.cost)
                queue.push(_Open(step.cost + rest, rest, before, step.cost, -math.inf))
                if self._is_over(result, best[0]):
                    result.outcome = SearchOutcome.TIME_LIMIT  # what is left of the condition may be cheaper
                    break
            if result.outcome is SearchOutcome.TIME_LIMIT:
                break
            dearer = self._next_bound(condition, up_to)
            if dearer < math.inf:
                queue.push(_Open(dearer, dearer - cost, condition, cost, up_to))
        else:
            result.bound = math.inf
        if best[0] < math.inf:
            result.start = best[1]
        result.steps = {one: steps[one] for one in (goal, *closed.costs, best[1])}
        result.seconds = self._clock() - self._began
        return result

    def _rest(self, condition: int, after: int) -> float:
        """Return a lower bound of the cost of a condition from its cuts, reusing those of its successor
        ``after``."""
        cuts = self._cuts.get(condition)
        if cuts is None:
            cuts = self._lm_cut.cuts(condition, self._lm_cut.kept(condition, self._cuts[after]))
            self._cuts[condition] = cuts
        return total(cuts)

    def _regressions(
        self, condition: int, cost: float, done: float, bound: float
    ) -> Iterator[tuple[int, RegressionStep]]:
        """Yield the predecessors of a condition through actions of plans with a cost bound in (``done``, ``bound``]."""
        domain = self._reachability.domain
        tried: set[int] = set()
        for literal in bits(condition):
            bounds, actions = self._achievers_of(literal)
            for action in actions[bisect_right(bounds, done) : bisect_right(bounds, bound)]:
                if action in tried or domain.deletes[action] & condition:
                    continue
                tried.add(action)
                kept = condition & ~domain.adds[action]
                if not self._excluded_with(action) & kept:
                    yield domain.needs[action] | kept, RegressionStep(cost + domain.costs[action], action, condition)

    def _next_bound(self, condition: int, bound: float) -> float:
        """Return the least cost above ``bound`` of a plan with an action that makes some of a condition true."""
        least = math.inf
        for literal in bits(condition):
            bounds = self._achievers_of(literal)[0]
            place = bisect_right(bounds, bound)
            if place < len(bounds):
                least = min(least, bounds[place])
        return least

    def _is_over(self, result: SearchResult, best: float) -> bool:
        now = self._now = self._clock()
        if self._report is not None and now - self._reported >= _REPORT_INTERVAL:
            self._reported = now
            self._report(
                SearchProgress(result.bound, best if best < math.inf else None, result.expanded, now - self._began)
            )
        return now >= self._deadline

    def _achievers_of(self, literal: int) -> tuple[list[float], list[int]]:
        """Return the actions that add a literal, sorted by the lower bound of a plan with them, and these bounds."""
        known = self._achievers.get(literal)
        if known is None:
            pairs = sorted(
                (self._bound_with(action), action) for action in self._reachability.achievers.get(literal, ())
            )
            known = self._achievers[literal] = ([bound for bound, _ in pairs], [action for _, action in pairs])
        return known

    def _bound_with(self, action: int) -> float:
        """Return a lower bound of the cost of a plan with this action.

        It is the sum of the cuts of the goal, and the remaining costs of the action and of the landmarks before it.
        """
        reachability = self._reachability
        before = reachability.before[action]
        reduction = sum(self._reductions[literal] for literal in bits(before & self._reduced))
        own = reachability.domain.costs[action] - self._taken.get(action, 0.0)
        return self._least + reachability.before_weights[action] - reduction + own

    def _excluded_with(self, action: int) -> int:
        """Return the literals that cannot be true before an action, or after it unless the action adds them."""
        known = self._excluded_before.get(action)
        if known is None:
            domain = self._reachability.domain
            known = union(self._of[literal] for literal in bits(domain.needs[action] | domain.adds[action]))
            self._excluded_before[action] = known
        return known


class _Open(NamedTuple):
    """An unexpanded condition: the lower bounds of a plan through it and of the ``rest`` of that plan, its cost, and
    the bound up to which it was expanded."""

    bound: float
    rest: float
    condition: int
    cost: float
    done: float


class _Queue:
    """The queue of unexpanded conditions, ordered by the least bound or by the least rest."""

    def __init__(self) -> None:
        self.nearest_first = False
        self._heap: list[tuple[float, float, _Open]] = []

    def __bool__(self) -> bool:
        return bool(self._heap)

    def push(self, one: _Open) -> None:
        order = (one.rest, one.bound) if self.nearest_first else (one.bound, one.rest)
        heapq.heappush(self._heap, (*order, one))

    def pop(self) -> _Open:
        return heapq.heappop(self._heap)[2]

    def take_nearest(self, nearest_first: bool) -> None:
        """Select the order: least rest first, or least bound first."""
        if nearest_first is not self.nearest_first:
            self.nearest_first = nearest_first
            self._heap = [(second, first, one) for first, second, one in self._heap]
            heapq.heapify(self._heap)


class _Closed:
    """The expanded conditions, in a form for subset queries: a condition covers all its supersets.

    It is a tree of literals, in the same order in all conditions. Rare literals, those that few actions use, come
    first.
    """

    def __init__(self) -> None:
        self.costs: Final[dict[int, float]] = {}
        self._root: Final = _Literals()

    def add(self, condition: int, cost: float) -> None:
        """Add a condition that leads to the goal at a cost; add it again only at a lower cost."""
        self.costs[condition] = cost
        node = self._root
        for literal in reversed(list(bits(condition))):
            node.known |= 1 << literal
            node = node.after.setdefault(literal, _Literals())
        node.cost = cost

    def covers(self, condition: int, cost: float) -> bool:
        """Return whether a subset of the condition leads to the goal at the same or a lower cost."""
        todo = [self._root]
        while todo:
            node = todo.pop()
            if node.cost <= cost:
                return True
            todo += [node.after[literal] for literal in bits(node.known & condition)]
        return False


@dataclass(slots=True)
class _Literals:
    """A node of the tree: the next literals, also as a bit set, and the cost if a condition ends here."""

    known: int = 0
    after: dict[int, _Literals] = field(default_factory=dict)
    cost: float = math.inf
