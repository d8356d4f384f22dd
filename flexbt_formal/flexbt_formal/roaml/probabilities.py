# SPDX-License-Identifier: BSD-3-Clause
"""Probabilities: exact in a graph of states, or with bounds from random runs."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from heapq import heapify, heappop, heappush
from typing import Final, NamedTuple

BAD: Final = 0
GOOD: Final = 1
_PRECISION: Final = 1e-12
_ROUNDS: Final = 10_000
"""Maximum rounds for a component that is only iterated."""
_POLICIES: Final = 1_000
_EQUAL: Final = 1e-13
"""Relative difference below which two choices are equally good."""
_HELD: Final = 2_000_000
"""Maximum number of probabilities in an elimination."""

GraphChoices = list[list[tuple[float, int]]]
"""Targets of each choice, with their probabilities."""


def reach(graph: Sequence[GraphChoices], is_least: bool) -> tuple[list[float], bool]:
    """Return the probability to reach :data:`GOOD` from each state, and whether it is exact; the first two states have
    no choices. If not, the greatest probability is only known to be no less.

    The strongly connected components are solved in the order of their dependencies. A cycle is solved by policy
    iteration (Howard 1960), each policy by an elimination without subtractions (Grassmann, Taksar, Heyman 1985), which
    is exact however rarely the cycle is left. Only what is too large for that is iterated from below.
    """
    values = [0.0] * len(graph)
    values[GOOD] = 1.0
    is_exact = True
    for component in _components(graph):
        members = {state for state in component if graph[state]}
        if is_least:
            members -= _staying(members, graph, values)
        if members and not _solve(members, graph, values, min if is_least else max):
            is_exact = False
            _iterate(members, graph, values, min if is_least else max)
    return values, is_exact


_Extreme = Callable[[Iterable[float]], float]
_Row = Sequence[tuple[float, int]]


def _value(row: _Row, values: Sequence[float]) -> float:
    return sum(p * values[target] for p, target in row)


def _staying(members: set[int], graph: Sequence[GraphChoices], values: Sequence[float]) -> set[int]:
    """Return the states that can avoid forever what may reach GOOD."""
    found = set(members)
    while True:
        leaving = {
            state
            for state in found
            if all(any(values[target] > 0.0 or target in members - found for _, target in row) for row in graph[state])
        }
        if not leaving:
            return found
        found -= leaving


def _solve(members: set[int], graph: Sequence[GraphChoices], values: list[float], extreme: _Extreme) -> bool:
    """Write the values of the states of one component; return False if it is too large."""
    policy = {state: graph[state][0] for state in members}
    for _ in range(_POLICIES):
        solved = _solution(policy, values)
        if solved is None:
            return False
        for state, value in solved.items():
            values[state] = value
        is_best = True
        for state in members:
            known = values[state]
            best = extreme(_value(row, values) for row in graph[state])
            if abs(best - known) > _EQUAL * known and extreme((best, known)) != known:
                policy[state] = next(row for row in graph[state] if _value(row, values) == best)
                is_best = False
        if is_best:
            return True
    return False


def _solution(policy: Mapping[int, _Row], values: Sequence[float]) -> dict[int, float] | None:
    """Return the values of states that take one row each; None if the elimination needs too much memory.

    ``leads[state]`` are the probabilities of the other states that remain, ``good`` and ``out`` those of GOOD and of
    all states outside.
    """
    leads: dict[int, dict[int, float]] = {}
    before: dict[int, set[int]] = {state: set() for state in policy}
    good, out = dict.fromkeys(policy, 0.0), dict.fromkeys(policy, 0.0)
    for state, row in policy.items():
        leads[state] = {}
        for p, target in row:
            if target not in policy:
                out[state] += p
                good[state] += p * values[target]
            elif target != state:
                leads[state][target] = leads[state].get(target, 0.0) + p
                before[target].add(state)
    held = sum(map(len, leads.values()))
    ahead = [(len(leads[state]) * len(before[state]), state) for state in policy]
    heapify(ahead)
    order = []
    while ahead:
        known, state = heappop(ahead)
        cost = len(leads[state]) * len(before[state])
        if cost > known:
            heappush(ahead, (cost, state))
            continue
        order.append(state)
        onward = leads[state]
        whole = sum(onward.values()) + out[state]
        for target in onward:
            before[target].discard(state)
            onward[target] /= whole
        if whole:
            good[state], out[state] = good[state] / whole, out[state] / whole
        for source in before[state]:
            part = leads[source].pop(state)
            good[source] += part * good[state]
            out[source] += part * out[state]
            held -= len(leads[source])
            for target, p in onward.items():
                if target != source:
                    leads[source][target] = leads[source].get(target, 0.0) + part * p
                    before[target].add(source)
            held += len(leads[source])
        if held > _HELD:
            return None
    found: dict[int, float] = {}
    for state in reversed(order):
        found[state] = min(good[state] + sum(p * found[target] for target, p in leads[state].items()), 1.0)
    return found


def _iterate(members: set[int], graph: Sequence[GraphChoices], values: list[float], extreme: _Extreme) -> None:
    """Bring the values of a component closer from below."""
    for state in members:
        values[state] = 0.0
    for _ in range(_ROUNDS):
        change = 0.0
        for state in members:
            new = extreme(_value(row, values) for row in graph[state])
            change = max(change, abs(new - values[state]))
            values[state] = new
        if change < _PRECISION:
            break


def _components(graph: Sequence[GraphChoices]) -> Iterator[list[int]]:
    """Yield the strongly connected components, successors first (Kosaraju and Sharir)."""
    after = [[target for row in rows for _, target in row] for rows in graph]
    before: list[list[int]] = [[] for _ in graph]
    for state, targets in enumerate(after):
        for target in targets:
            before[target].append(state)
    seen: set[int] = set()
    order = [state for root in range(len(graph)) for state in _reached(root, before, seen)]
    seen.clear()
    for root in reversed(order):
        component = list(_reached(root, after, seen))
        if component:
            yield component


def _reached(root: int, edges: Sequence[Sequence[int]], seen: set[int]) -> Iterator[int]:
    """Yield a state and all states reachable from it that are not in ``seen``, in postorder."""
    if root in seen:
        return
    seen.add(root)
    ahead = [(root, iter(edges[root]))]
    while ahead:
        state, targets = ahead[-1]
        target = next((one for one in targets if one not in seen), None)
        if target is None:
            ahead.pop()
            yield state
        else:
            seen.add(target)
            ahead.append((target, iter(edges[target])))


# The number of random runs that is enough, and the bounds of the probability after them.

_FIRST_LOOK: Final = 100
_BETWEEN_LOOKS: Final = 0.6
"""Runs up to one interim look, as a fraction of the runs up to the next."""
_HALVINGS: Final = 60


class ProbabilityBounds(NamedTuple):
    """The fraction ``value`` of good runs, and the bounds of the probability."""

    value: float
    low: float
    high: float

    @property
    def error(self) -> float:
        """Maximum distance of the probability from the value: near 0 and 1 that is one end of the bounds."""
        return max(self.high - self.value, self.value - self.low)


def looks(error: float, confidence: float) -> dict[int, float]:
    """Return the numbers of runs after which to test whether the bounds are within ``error``, each with its doubt.

    The doubts add up to 1 - ``confidence``. The last look has half of that. After it the bounds are within the error
    for any probability: ln(2/δ) / 2ε² runs (Okamoto 1958).
    """
    half = (1.0 - confidence) / 2.0
    last = math.ceil(math.log(2.0 / half) / (2.0 * error**2))
    before = [last]
    while before[-1] > _FIRST_LOOK:
        before.append(max(math.ceil(before[-1] * _BETWEEN_LOOKS), _FIRST_LOOK))
    doubt = half / max(len(before) - 1, 1)
    return dict.fromkeys(reversed(before[1:]), doubt) | {last: half}


def bounds_of(good: int, undecided: int, done: int, doubt: float) -> ProbabilityBounds:
    """Return the bounds of the probability: outside of them, this number of good runs is less likely than the doubt.

    On each side, the relative entropy of the observed fraction to the bound is at most ln(2/δ) / n (Chernoff 1952;
    Hoeffding 1963, Theorem 1). Near 0 and 1 this is much tighter than Okamoto's bound, and nowhere wider.
    """
    most = math.log(2.0 / doubt) / done
    value = good / done
    return ProbabilityBounds(value, 1.0 - _above(1.0 - value, most), _above((good + undecided) / done, most))


def _above(seen: float, most: float) -> float:
    """Return the greatest probability, from ``seen`` on, whose relative entropy is not above ``most``."""
    low, high = seen, 1.0
    for _ in range(_HALVINGS):
        tried = (low + high) / 2.0
        entropy = seen * math.log(seen / tried) if seen > 0.0 else 0.0
        if seen < 1.0:
            entropy += (1.0 - seen) * math.log((1.0 - seen) / (1.0 - tried)) if tried < 1.0 else math.inf
        low, high = (tried, high) if entropy <= most else (low, tried)
    return high
