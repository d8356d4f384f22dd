# SPDX-License-Identifier: BSD-3-Clause
"""Probabilities in a graph of states: to reach the good end, least or greatest over the choices."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

BAD: Final = 0
GOOD: Final = 1
PRECISION: Final = 1e-12
_ROUNDS: Final = 1_000_000

Choices = list[list[tuple[float, int]]]
"""Of each choice where it leads to, and how probably."""


def reach(graph: Sequence[Choices], is_least: bool) -> list[float]:
    """The probability to come to :data:`GOOD` from each state, of which no choices go on from the first two.

    Component by component, in the order in which they depend on one another: a state of its own is exact at once; one
    in a circle is iterated from below until nothing changes by more than 1e-12, after those are set apart from which
    GOOD is never reached.
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
    """What a choice gives; one that stays with some probability is taken until it leaves."""
    stays = sum(p for p, target in row if target == state)
    if stays >= 1.0:
        return 0.0
    return sum(p * values[target] for p, target in row if target != state) / (1.0 - stays)


def _components(graph: Sequence[Choices]) -> list[list[int]]:
    """Strongly connected components, those that others lead to first (Tarjan, without recursion)."""
    index: list[int] = [-1] * len(graph)
    low = [0] * len(graph)
    on_stack = [False] * len(graph)
    stack: list[int] = []
    found: list[list[int]] = []
    count = 0
    for root in range(len(graph)):
        if index[root] >= 0:
            continue
        work = [(root, iter([target for row in graph[root] for _, target in row]))]
        index[root] = low[root] = count
        count += 1
        stack.append(root)
        on_stack[root] = True
        while work:
            state, targets = work[-1]
            for target in targets:
                if index[target] < 0:
                    index[target] = low[target] = count
                    count += 1
                    stack.append(target)
                    on_stack[target] = True
                    work.append((target, iter([after for row in graph[target] for _, after in row])))
                    break
                if on_stack[target]:
                    low[state] = min(low[state], index[target])
            else:
                work.pop()
                if work:
                    low[work[-1][0]] = min(low[work[-1][0]], low[state])
                if low[state] == index[state]:
                    component = []
                    while True:
                        member = stack.pop()
                        on_stack[member] = False
                        component.append(member)
                        if member == state:
                            break
                    found.append(component)
    return found
