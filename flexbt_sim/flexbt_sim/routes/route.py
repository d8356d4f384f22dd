# SPDX-License-Identifier: BSD-3-Clause
"""Finds the cheapest route: Dijkstra's algorithm on the graph."""

from __future__ import annotations

import heapq
import itertools
from collections.abc import Callable, Collection
from dataclasses import dataclass

from flexbt_sim.errors import NavigationError

from .edge_scorers import RouteRequest, Scorer
from .graph import RouteEdge, RouteGraph, RouteNode


@dataclass(frozen=True)
class Route:
    """From a node over edges; ``costs`` are those of the edges. Without edges it is the node."""

    start: RouteNode
    edges: tuple[RouteEdge, ...] = ()
    costs: tuple[float, ...] = ()

    @property
    def nodes(self) -> tuple[RouteNode, ...]:
        """One more than edges."""
        return (self.start, *(edge.end for edge in self.edges))

    @property
    def cost(self) -> float:
        return sum(self.costs)


def find_route(
    graph: RouteGraph,
    request: RouteRequest,
    score: Scorer,
    blocked: Collection[int] = (),
    check_time: Callable[[], None] = lambda: None,
) -> Route:
    """The cheapest route. Edges, and nodes, with an id among the ``blocked`` are not used.

    ``check_time()`` is called now and then.

    Raises:
        NavigationError: NO_VALID_ROUTE; what ``score`` and ``check_time`` raise.
    """
    start, goal = request.start, request.goal
    best = {start.id: 0.0}
    by: dict[int, tuple[RouteEdge, float]] = {}
    done: set[int] = set()
    order = itertools.count()  # nodes cannot be compared
    queue = [(0.0, next(order), start)]
    while queue:
        cost, _, node = heapq.heappop(queue)
        if node is goal:
            return _route(start, goal, by)
        if node.id in done:
            continue
        done.add(node.id)
        check_time()
        for edge in graph.leaving(node):
            if edge.id in blocked or edge.end.id in blocked or edge.end.id in done:
                continue
            step = score(edge, request)
            if step is not None and cost + step < best.get(edge.end.id, float('inf')):
                best[edge.end.id] = cost + step
                by[edge.end.id] = edge, step
                heapq.heappush(queue, (cost + step, next(order), edge.end))
    raise NavigationError('NO_VALID_ROUTE', f'no open route leads from node {start.id} to node {goal.id}')


def _route(start: RouteNode, goal: RouteNode, by: dict[int, tuple[RouteEdge, float]]) -> Route:
    steps = []
    node = goal
    while node is not start:
        edge, cost = by[node.id]
        steps.append((edge, cost))
        node = edge.start
    steps.reverse()
    return Route(start, tuple(edge for edge, _ in steps), tuple(cost for _, cost in steps))
