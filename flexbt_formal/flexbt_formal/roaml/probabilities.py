# SPDX-License-Identifier: BSD-3-Clause
"""Probabilities: exact in a graph of states, or with bounds from random runs."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import Final, NamedTuple

BAD: Final = 0
GOOD: Final = 1
PRECISION: Final = 1e-12
_ROUNDS: Final = 1_000_000

GraphChoices = list[list[tuple[float, int]]]
"""Targets of each choice, with their probabilities."""


def reach(graph: Sequence[GraphChoices], is_least: bool) -> list[float]:
    """Return the probability to reach :data:`GOOD` from each state; the first two states have no choices.

    The strongly connected components are solved in the order of their dependencies. A single state is exact at once. A
    cycle is iterated from below until no value changes by more than 1e-12, after the states that never reach GOOD are
    excluded.
    """
    values = [0.0] * len(graph)
    values[GOOD] = 1.0
    extreme = min if is_least else max
    for component in _components(graph):
        if component[0] in (BAD, GOOD):
            continue
        members = set(component)
        is_round = len(component) > 1 or any(target in members for row in graph[component[0]] for _, target in row)
        if not is_round:
            state = component[0]
            if graph[state]:
                values[state] = extreme(sum(p * values[target] for p, target in row) for row in graph[state])
            continue
        for _ in range(_ROUNDS):
            change = 0.0
            for state in component:
                new = extreme(_leaving(state, row, values) for row in graph[state])
                change = max(change, abs(new - values[state]))
                values[state] = new
            if change < PRECISION:
                break
    return values


def _leaving(state: int, row: list[tuple[float, int]], values: Sequence[float]) -> float:
    """Return the value of a choice; a choice that may stay in its state is repeated until it leaves."""
    stays = sum(p for p, target in row if target == state)
    if stays >= 1.0:
        return 0.0
    return sum(p * values[target] for p, target in row if target != state) / (1.0 - stays)


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
