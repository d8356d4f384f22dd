# SPDX-License-Identifier: BSD-3-Clause
"""LM-cut (Helmert, Domshlak: *Landmarks, critical paths and abstractions: what's the difference anyway?*, ICAPS 2009).

A lower bound of the cost of a condition: sets of actions are cut out of the delete relaxation, one of each of which is
in every plan. Each set counts with its cheapest action, whose cost all of the set lose; until the condition costs
nothing more.
"""

from __future__ import annotations

import heapq
import math
from collections import defaultdict
from typing import Final

from flexbt_core.planning.problems import bits

from .reachability import Reachability


class LmCut:
    """Lower bounds from one state to many conditions; each is computed once."""

    def __init__(self, reachability: Reachability) -> None:
        self._reachability: Final = reachability
        self._bounds: Final[dict[int, float]] = {}
        domain = reachability.domain
        self._known: Final = reachability.initial
        self._achievers: Final[dict[int, list[tuple[int, list[int], list[int]]]]] = {}
        self._costs: Final = domain.costs

    def bound(self, condition: int) -> float:
        """What it costs at least to make a condition true; infinite where it cannot be made true."""
        condition &= ~self._known
        known = self._bounds.get(condition)
        if known is None:
            known = self._bounds[condition] = self.cuts(condition)[0]
        return known

    def cuts(self, condition: int) -> tuple[float, dict[int, float]]:
        """The bound, and for the actions that matter what is left of their costs."""
        goals = list(bits(condition & ~self._known))
        if any(self._reachability.costs[goal] == math.inf for goal in goals):
            return math.inf, {}
        landmarks = self._reachability.landmarks_of(goals)
        relevant = self._relevant(goals)
        left = {action: self._costs[action] for action, _, _ in relevant}
        adders: dict[int, list[int]] = defaultdict(list)
        users: dict[int, list[int]] = defaultdict(list)
        for action, needs, adds in relevant:
            for literal in adds:
                adders[literal].append(action)
            for literal in needs:
                users[literal].append(action)
        needs_of = {action: needs for action, needs, _ in relevant}
        adds_of = {action: adds for action, _, adds in relevant}
        bound = 0.0
        while goals:
            costs = _relaxed_costs(left, needs_of, adds_of, users)
            supporters = {
                action: max(needs, key=lambda need: (costs[need], landmarks >> need & 1, need)) if needs else None
                for action, needs in needs_of.items()
            }
            top = max(goals, key=costs.__getitem__)
            if costs[top] == 0.0:
                break
            zone = _zone(top, left, adders, supporters)
            cut = _cut(zone, adds_of, supporters)
            least = min(left[action] for action in cut)
            bound += least
            for action in cut:
                left[action] -= least
        return bound, left

    def _relevant(self, goals: list[int]) -> list[tuple[int, list[int], list[int]]]:
        """The actions on ways to the goals: number, what they need and what they add beside what is there."""
        found: dict[int, tuple[int, list[int], list[int]]] = {}
        todo = list(goals)
        seen = set(todo)
        while todo:
            for entry in self._first(todo.pop()):
                found[entry[0]] = entry
                for need in entry[1]:
                    if need not in seen:
                        seen.add(need)
                        todo.append(need)
        return list(found.values())

    def _first(self, literal: int) -> list[tuple[int, list[int], list[int]]]:
        known = self._achievers.get(literal)
        if known is None:
            domain, new = self._reachability.domain, ~self._known
            known = self._achievers[literal] = [
                (action, list(bits(domain.needs[action] & new)), list(bits(domain.adds[action] & new)))
                for action in self._reachability.first.get(literal, ())
            ]
        return known


def _relaxed_costs(
    left: dict[int, float], needs_of: dict[int, list[int]], adds_of: dict[int, list[int]], users: dict[int, list[int]]
) -> dict[int, float]:
    costs: dict[int, float] = {}
    queue: list[tuple[float, int]] = []
    missing = {action: len(needs) for action, needs in needs_of.items()}
    done = set()

    def run(action: int, cost: float) -> None:
        cost += left[action]
        for literal in adds_of[action]:
            if cost < costs.get(literal, math.inf):
                costs[literal] = cost
                heapq.heappush(queue, (cost, literal))

    for action, count in missing.items():
        if not count:
            run(action, 0.0)
    while queue:
        cost, literal = heapq.heappop(queue)
        if literal in done:
            continue
        done.add(literal)
        for action in users.get(literal, ()):
            missing[action] -= 1
            if not missing[action]:
                run(action, cost)
    return costs


def _zone(
    top: int, left: dict[int, float], adders: dict[int, list[int]], supporters: dict[int, int | None]
) -> set[int]:
    """The literals from which ``top`` is reached at no more cost."""
    zone = {top}
    todo = [top]
    while todo:
        for action in adders[todo.pop()]:
            supporter = supporters[action]
            if left[action] == 0.0 and supporter is not None and supporter not in zone:
                zone.add(supporter)
                todo.append(supporter)
    return zone


def _cut(zone: set[int], adds_of: dict[int, list[int]], supporters: dict[int, int | None]) -> set[int]:
    """The actions that lead from what is reached outside of the zone into it."""
    supported: dict[int | None, list[int]] = defaultdict(list)
    for action, supporter in supporters.items():
        supported[supporter].append(action)
    cut: set[int] = set()
    reached: set[int] = set()
    todo: list[int | None] = [None]
    while todo:
        for action in supported[todo.pop()]:
            if not zone.isdisjoint(adds_of[action]):
                cut.add(action)
                continue
            for literal in adds_of[action]:
                if literal not in reached:
                    reached.add(literal)
                    todo.append(literal)
    return cut
