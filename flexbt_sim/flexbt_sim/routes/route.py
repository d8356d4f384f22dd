# SPDX-License-Identifier: BSD-3-Clause
"""Finds the cheapest route."""

from __future__ import annotations

from collections.abc import Callable, Collection
from dataclasses import dataclass

import numpy

from flexbt_sim.navigation_errors import NavigationError

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

    ``check_time()`` is called before and after the search.

    Raises:
        NavigationError: NO_VALID_ROUTE; NO_VALID_GRAPH for an edge that the search meets and whose own cost is not
            positive; what ``score`` and ``check_time`` raise.
    """
    start, goal, links = request.start, request.goal, graph.links
    check_time()
    costs = score(graph, request)
    avoided = list(blocked)
    costs = numpy.where(numpy.isin(links.edge_ids, avoided) | numpy.isin(links.end_ids, avoided), numpy.inf, costs)
    is_wrong = numpy.isnan(costs)
    costs[is_wrong] = numpy.inf
    first, last = links.index[start.id], links.index[goal.id]
    distances, before = links.search(costs, first)
    check_time()
    # Nav2's search looks at all edges of a node that is nearer than the goal, also at those that lead back.
    is_met = (distances[links.starts] < distances[last]) | ((links.starts == first) & (first != last))
    met = numpy.flatnonzero(is_wrong & is_met)
    if met.size:
        edge = graph.edges[met[0]]
        raise NavigationError(
            'NO_VALID_GRAPH', f'edge {edge.id} has the cost {edge.cost:g}, which nothing overrides; give more'
        )
    if numpy.isinf(distances[last]):
        raise NavigationError('NO_VALID_ROUTE', f'no open route leads from node {start.id} to node {goal.id}')
    steps: list[int] = []
    while last != first:
        steps.append(links.cheapest(costs, int(before[last]), last))
        last = int(before[last])
    steps.reverse()
    return Route(start, tuple(graph.edges[step] for step in steps), tuple(costs[steps].tolist()))
