# SPDX-License-Identifier: BSD-3-Clause
"""The delete relaxation: exclusive literals, reachability, landmarks, and the lower bound LM-cut.

An exclusive set grows from one literal. Each action that makes a member true has to make the others false, or to
replace a member that it needs and makes false; literals that are missing for this join the set (invariants as in
Helmert, *Concise finite-domain representations for PDDL planning tasks*, 2009, here on grounded actions). The results
are correct, but not complete.
"""

from __future__ import annotations

import heapq
import math
from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence
from functools import reduce
from itertools import islice
from operator import and_
from typing import Final, NamedTuple

from .problem import Domain, bits, union

_MOST_PAIRS: Final = 4
"""Maximum number of pairs that are tried for a literal."""


class Exclusions:
    """Literals that exclude each other in all states reachable from ``initial``."""

    def __init__(self, domain: Domain, initial: int) -> None:
        self._domain = domain
        self._initial = initial
        self._adders: Final = _by_literal({action: bits(adds) for action, adds in enumerate(domain.adds)})
        self.of: Final = [0] * len(domain.literals)
        failed: set[int] = set()
        done = 0
        for literal in bits(union(domain.deletes)):
            if done >> literal & 1 or literal in failed or literal not in self._adders:
                continue
            group = self._largest(literal, failed)
            if group is None:
                failed.add(literal)
            elif group.bit_count() > 1:
                done |= group
                for member in bits(group):
                    self.of[member] |= group & ~(1 << member)

    def _largest(self, literal: int, failed: set[int]) -> int | None:
        """Return the set of a literal. If the set would have no other literal, add one that an action exchanges for
        it."""
        alone = self._group(1 << literal | self._others_of_adders(literal), failed)
        if alone is None or alone.bit_count() > 1:
            return alone
        needs, deletes = self._domain.needs, self._domain.deletes
        moved = union(needs[action] & deletes[action] for action in self._adders[literal])
        pairs = (self._group(1 << literal | 1 << other, failed) for other in bits(moved) if other not in failed)
        return next((pair for pair in islice(pairs, _MOST_PAIRS) if pair is not None), alone)

    def _group(self, seeds: int, failed: set[int]) -> int | None:
        domain = self._domain
        group = seeds
        todo = list(bits(group))
        while todo:
            for action in self._adders.get(todo.pop(), ()):
                adds, deletes = domain.adds[action], domain.deletes[action]
                if (adds & group).bit_count() > 1:
                    return None
                left = group & ~adds & ~deletes
                moved = domain.needs[action] & deletes
                if not left or moved & group:
                    continue
                candidates = [literal for literal in bits(moved) if literal not in failed]
                if len(candidates) != 1:
                    return None
                group |= 1 << candidates[0]
                todo.append(candidates[0])
        return group if (group & self._initial).bit_count() <= 1 and self._holds(group) else None

    def _others_of_adders(self, seed: int) -> int:
        """Return the literals that all adders of a literal make false, such as the other places of a robot."""
        return reduce(and_, (self._domain.deletes[action] for action in self._adders[seed]))

    def _holds(self, group: int) -> bool:
        domain = self._domain
        for literal in bits(group):
            for action in self._adders.get(literal, ()):
                adds, deletes = domain.adds[action], domain.deletes[action]
                if (adds & group).bit_count() > 1:
                    return False
                if group & ~adds & ~deletes and not domain.needs[action] & deletes & group:
                    return False
        return True

    def excluded(self, condition: int) -> bool:
        """Return whether a condition has two literals that exclude each other."""
        return any(self.of[literal] & condition for literal in bits(condition))


# Reachability from a state if no literal ever becomes false (the delete relaxation), for all goals at once.
# Least costs of literals (h_max), their achievers, and their landmarks: literals that are true at some time on each
# path to them. For a domain with 7,300 actions this takes about 0.1 s; the queries for goals after that are frequent.


class Reachability:
    """A domain, seen from a state.

    - ``costs[p]``: least cost of literal p if each action costs its own cost plus its dearest need; infinite if
      unreachable.
    - ``needed[a]``: the same for the needs of action a.
    - ``achievers[p]``: reachable actions that make p true.
    - ``first[p]``: achievers that do not require p to be reached before; only they can be the first to make it true.
    - ``landmarks[p]``: bit set, including p and the initial literals.
    - ``weights[p]``: lower bound of the cost of p. The weights of the literals that one action adds sum up to at most
      its cost, so the weights of any landmarks may be added up.
    - ``before[a]``: landmarks of the needs of action a; ``before_weights[a]``: the sum of their weights.
    - ``needs[a]`` and ``adds[a]``: needs and effects of action a without the initial literals.

    ``without`` are the numbers of excluded actions.
    """

    def __init__(self, domain: Domain, initial: int, without: Iterable[int] = ()) -> None:
        self.domain: Final = domain
        self.initial: Final = initial
        self.exclusions: Final = Exclusions(domain, initial)
        count = len(domain.literals)
        self.needs: Final = [list(bits(needs & ~initial)) for needs in domain.needs]
        self.adds: Final = [list(bits(adds & ~initial)) for adds in domain.adds]
        self.costs: Final = [0.0 if initial >> literal & 1 else math.inf for literal in range(count)]
        needs_of = dict(enumerate(self.needs))
        for action in without:
            needs_of.pop(action, None)
        reached = _relaxed_costs(domain.costs, needs_of, self.adds, _by_literal(needs_of))
        for literal, cost in reached.items():
            self.costs[literal] = cost
        self.needed: Final = [
            max((self.costs[need] for need in needs), default=0.0) if action in needs_of else math.inf
            for action, needs in enumerate(self.needs)
        ]
        self.achievers: Final = _by_literal(
            {action: bits(domain.adds[action]) for action, needed in enumerate(self.needed) if needed < math.inf}
        )
        self.landmarks: Final = [
            1 << literal if initial >> literal & 1 else (1 << count) - 1 for literal in range(count)
        ]
        order = sorted((p for p in self.achievers if not initial >> p & 1), key=self.costs.__getitem__)
        self._find_landmarks(order)
        self.first: Final[dict[int, list[int]]] = {
            literal: [
                action
                for action in self.achievers[literal]
                if not any(self.landmarks[need] >> literal & 1 for need in self.needs[action])
            ]
            for literal in order
        }
        self.weights: Final = self._weigh(order)
        self.before: Final = [self.landmarks_of(needs) for needs in self.needs]
        by_weight: dict[float, int] = defaultdict(int)
        for literal, weight in enumerate(self.weights):
            if weight:
                by_weight[weight] |= 1 << literal
        self._by_weight: Final = list(by_weight.items())
        self.before_weights: Final = [self.weight(landmarks) for landmarks in self.before]

    def landmarks_of(self, literals: list[int]) -> int:
        """Return the literals that are true at some time on each path to these literals."""
        mask = 0
        for literal in literals:  # called often with few literals: union would take twice as long
            mask |= self.landmarks[literal]
        return mask

    def weight(self, landmarks: int) -> float:
        """Return a lower bound of the cost of these landmarks."""
        return sum(weight * (landmarks & mask).bit_count() for weight, mask in self._by_weight)

    def _find_landmarks(self, order: list[int]) -> None:
        """Compute the greatest fixed point: a literal has its own landmarks, and those that all its achievers share."""
        changed = True
        while changed:
            changed = False
            for literal in order:
                common = -1
                for action in self.achievers[literal]:
                    common &= self.landmarks_of(self.needs[action])
                common |= 1 << literal
                if common != self.landmarks[literal]:
                    self.landmarks[literal] = common
                    changed = True

    def _weigh(self, order: list[int]) -> list[float]:
        left = list(self.domain.costs)
        weights = [0.0] * len(self.domain.literals)
        for literal in sorted(order, key=lambda literal: len(self.achievers[literal])):
            weight = weights[literal] = min(left[action] for action in self.achievers[literal])
            if weight:
                for action in self.achievers[literal]:
                    left[action] -= weight
        return weights


# LM-cut (Helmert, Domshlak: *Landmarks, critical paths and abstractions: what's the difference anyway?*, ICAPS 2009).
# A lower bound of the cost of a condition. A cut is a set of actions of which every plan contains at least one. Each
# cut counts with the cost of its cheapest action, and all its actions become cheaper by that cost. The cuts end when
# the condition costs nothing.
# A condition of a search shares most of its literals, and so most cuts, with its successor. The cuts that still hold
# are kept, and only the missing ones are computed (Pommerening, Helmert: *Incremental LM-cut*, ICAPS 2013).


class Cut(NamedTuple):
    """A cut: one of the ``actions`` is needed to make a literal of ``zone`` (a bit set) true; ``cost`` counts."""

    zone: int
    actions: tuple[int, ...]
    cost: float


Cuts = tuple[Cut, ...]


def total(cuts: Cuts) -> float:
    """Return the lower bound that the cuts prove."""
    return sum(cut.cost for cut in cuts)


class LmCut:
    """Lower bounds of the cost from one state to many conditions of reachable literals."""

    def __init__(self, reachability: Reachability) -> None:
        self._reachability: Final = reachability
        self._known: Final = reachability.initial
        self._costs: Final = reachability.domain.costs

    def kept(self, condition: int, cuts: Cuts) -> Cuts:
        """Return the cuts of another condition that also hold for this one: a bound that is cheap to compute."""
        lacking = condition & ~self._known
        return tuple(cut for cut in cuts if cut.zone & lacking)

    def cuts(self, condition: int, kept: Cuts = ()) -> Cuts:
        """Return the cuts of a condition, beginning with the known ones (:meth:`kept`)."""
        goals = list(bits(condition & ~self._known))
        landmarks = self._reachability.landmarks_of(goals)
        needs_of = {action: self._reachability.needs[action] for action in self._relevant(goals)}
        adds_of = {action: self._reachability.adds[action] for action in needs_of}
        adders, users = _by_literal(adds_of), _by_literal(needs_of)
        left = {action: self._costs[action] for action in needs_of}
        for cut in kept:
            for action in cut.actions:
                if action in left:
                    left[action] = max(left[action] - cut.cost, 0.0)
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

    def _relevant(self, goals: list[int]) -> Iterable[int]:
        """Return the actions on paths to the goals."""
        found: dict[int, None] = {}
        todo = list(goals)
        seen = set(todo)
        while todo:
            for action in self._reachability.first.get(todo.pop(), ()):
                found[action] = None
                for need in self._reachability.needs[action]:
                    if need not in seen:
                        seen.add(need)
                        todo.append(need)
        return found


def _by_literal(literals_of: Mapping[int, Iterable[int]]) -> dict[int, list[int]]:
    """Return the actions by each of their literals."""
    found: dict[int, list[int]] = defaultdict(list)
    for action, literals in literals_of.items():
        for literal in literals:
            found[literal].append(action)
    return found


def _relaxed_costs(
    left: Mapping[int, float] | Sequence[float],
    needs_of: Mapping[int, list[int]],
    adds_of: Mapping[int, list[int]] | Sequence[list[int]],
    users: Mapping[int, list[int]],
) -> dict[int, float]:
    """Return the least costs of literals if each action costs its dearest need plus its remaining cost (``left``)."""
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
    """Return the literals from which ``top`` is reached at no more cost."""
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
    """Return the actions that lead into the zone from literals outside it."""
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
