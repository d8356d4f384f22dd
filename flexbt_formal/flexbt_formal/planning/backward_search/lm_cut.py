# SPDX-License-Identifier: BSD-3-Clause
"""LM-cut (Helmert, Domshlak: *Landmarks, critical paths and abstractions: what's the difference anyway?*, ICAPS 2009).

A lower bound of the cost of a condition: sets of actions are cut out of the delete relaxation, one of each of which is
in every plan. Each set counts with its cheapest action, whose cost all of the set lose; until the condition costs
nothing more.

Conditions of a search have most in common with the one from which they are regressed, and so have their cuts: those
which are still true of it are kept, and only what is lacking is computed (Pommerening, Helmert: *Incremental LM-cut*,
ICAPS 2013).
"""

from __future__ import annotations

import heapq
from collections import defaultdict
from typing import Final, NamedTuple

from flexbt_formal.planning.problems import bits

from .reachability import Reachability


class Cut(NamedTuple):
    """Whatever makes one of the literals ``zone`` (a bit set) true does one of the ``actions``; ``cost`` counts."""

    zone: int
    actions: tuple[int, ...]
    cost: float


Cuts = tuple[Cut, ...]


def total(cuts: Cuts) -> float:
    """The lower bound that cuts are."""
    return sum(cut.cost for cut in cuts)


class LmCut:
    """Lower bounds from one state to many conditions of literals that can be reached."""

    def __init__(self, reachability: Reachability) -> None:
        self._reachability: Final = reachability
        self._known: Final = reachability.initial
        self._achievers: Final[dict[int, list[tuple[int, list[int], list[int]]]]] = {}
        self._costs: Final = reachability.domain.costs

    def kept(self, condition: int, cuts: Cuts) -> Cuts:
        """Those of the cuts of another condition that are cuts of this one, too: a bound that costs little."""
        lacking = condition & ~self._known
        return tuple(cut for cut in cuts if cut.zone & lacking)

    def cuts(self, condition: int, kept: Cuts = ()) -> Cuts:
        """The cuts of a condition, beginning with those that are known of it (:meth:`kept`)."""
        goals = list(bits(condition & ~self._known))
        landmarks = self._reachability.landmarks_of(goals)
        relevant = self._relevant(goals)
        left = {action: self._costs[action] for action, _, _ in relevant}
        for cut in kept:
            for action in cut.actions:
                if action in left:
                    left[action] = max(left[action] - cut.cost, 0.0)
        adders: dict[int, list[int]] = defaultdict(list)
        users: dict[int, list[int]] = defaultdict(list)
        for action, needs, adds in relevant:
            for literal in adds:
                adders[literal].append(action)
            for literal in needs:
                users[literal].append(action)
        needs_of = {action: needs for action, needs, _ in relevant}
        adds_of = {action: adds for action, _, adds in relevant}
        found = list(kept)
        while goals:
            costs = _relaxed_costs(left, needs_of, adds_of, users)
            top = max(goals, key=costs.__getitem__)
            if costs[top] == 0.0:
                break
            supporters = {
                action: max(needs, key=lambda need: (costs[need], landmarks >> need & 1, need)) if needs else None
                for action, needs in needs_of.items()
            }
            zone = _zone(top, left, adders, supporters)
            actions = tuple(_cut(zone, adds_of, supporters))
            least = min(left[action] for action in actions)
            found.append(Cut(sum(1 << literal for literal in zone), actions, least))
            for action in actions:
                left[action] -= least
        return tuple(found)

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
            if literal not in costs or cost < costs[literal]:
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
