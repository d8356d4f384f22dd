# SPDX-License-Identifier: BSD-3-Clause
"""The cheapest route through a graph, and its path."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection
from dataclasses import dataclass
from itertools import pairwise

import numpy

from flexbt_core.values.parameter_fields import parameter
from flexbt_navigation.errors import NavigationError
from flexbt_sim.world.plane.geometry import Point, Pose

from .edge_scorers import RouteRequest, Scorer
from .graph import RouteEdge, RouteGraph, RouteNode


@dataclass(frozen=True)
class Route:
    """A route from a node over edges; ``costs`` are those of the edges. Without edges it is the node."""

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
    """Return the cheapest route. Edges, and nodes, with an id among the ``blocked`` are not used.

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


# Routes as dense paths, with their corners rounded off: Nav2's path converter.


@dataclass(frozen=True)
class PathShape:
    """The shape of paths along routes."""

    density: float = parameter('path_density', 0.05, "greatest distance of the poses of a route's path, m", 0.01, 10.0)
    radius: float = parameter('smoothing_radius', 1.0, "radius of the corners of a route's path, m", 0.01, 100.0)
    is_rounded: bool = parameter('smooth_corners', True, "whether the corners of a route's path are rounded")


def route_path(route: Route, shape: PathShape, begin: Point | None = None) -> list[Pose]:
    """Return the poses along a route, each heading to the next, and the last one as its edge.

    ``begin`` is where the robot is on the edge that leads to the first node, when it is on its way there. A corner
    stays as it is where its edges are too short for the arc.
    """
    corners = [node.point for node in route.nodes]
    points: list[Point] = []
    if begin is not None:
        points += _line(begin, corners[0], shape.density)
    here = corners[0]
    for corner, after in pairwise(corners[1:]):
        arc = _arc(here, corner, after, shape)
        points += _line(here, arc[0], shape.density) + arc[:-1]
        here = arc[-1]
    points += [*_line(here, corners[-1], shape.density), corners[-1]]
    points = [points[0], *(after for before, after in pairwise(points) if after != before)]
    yaws = [math.atan2(after[1] - before[1], after[0] - before[0]) for before, after in pairwise(points)]
    last = route.edges[-1].heading if route.edges else yaws[-1] if yaws else 0.0
    return [Pose(x, y, yaw) for (x, y), yaw in zip(points, [*yaws, last], strict=True)]


def _line(start: Point, end: Point, density: float) -> list[Point]:
    """Points from start to before end."""
    count = math.ceil(math.dist(start, end) / density)
    return [
        (start[0] + (end[0] - start[0]) * step / count, start[1] + (end[1] - start[1]) * step / count)
        for step in range(count)
    ]


def _arc(start: Point, corner: Point, end: Point, shape: PathShape) -> list[Point]:
    """Points of the arc that touches both lines of a corner, or the corner itself."""
    before, after = math.dist(start, corner), math.dist(corner, end)
    if not (shape.is_rounded and before and after):
        return [corner]
    ax, ay = (start[0] - corner[0]) / before, (start[1] - corner[1]) / before
    bx, by = (end[0] - corner[0]) / after, (end[1] - corner[1]) / after
    angle = math.atan2(abs(ax * by - ay * bx), ax * bx + ay * by)
    if angle < 1e-6 or math.pi - angle < 1e-6:  # back where it came from, or straight on
        return [corner]
    tangent = shape.radius / math.tan(angle / 2.0)
    if not (tangent < before and tangent < after):
        return [corner]
    first = corner[0] + ax * tangent, corner[1] + ay * tangent
    away = shape.radius / math.sin(angle / 2.0) / math.hypot(ax + bx, ay + by)
    centre = corner[0] + (ax + bx) * away, corner[1] + (ay + by) * away
    turn = math.copysign(math.pi - angle, ay * bx - ax * by)
    begin = math.atan2(first[1] - centre[1], first[0] - centre[0])
    count = max(1, math.ceil(abs(turn) * shape.radius / shape.density))
    return [
        (
            centre[0] + shape.radius * math.cos(begin + turn * step / count),
            centre[1] + shape.radius * math.sin(begin + turn * step / count),
        )
        for step in range(count + 1)
    ]
