# SPDX-License-Identifier: BSD-3-Clause
"""Route planning: from a request to a route and its path, the first time and whenever the route has to change."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import product
from typing import Final

from flexbt_navigation.costmaps.costmap import INSCRIBED, Costmap
from flexbt_navigation.errors import NavigationError
from flexbt_sim.world.plane.geometry import Point, Pose

from .edge_scorers import RouteRequest, Scorer
from .graph import RouteEdge, RouteGraph, RouteNode
from .lines import closest_point, cosine, line_costs
from .route import PathShape, Route, find_route, route_path


@dataclass(frozen=True)
class Ends:
    """Start or end of a route: a node of the graph by its id, or a pose."""

    id: int = 0
    pose: Pose | None = None

    def node(self, graph: RouteGraph, costmap: Costmap | None) -> RouteNode:
        """Raise NavigationError INDETERMINANT_NODES_ON_GRAPH."""
        if self.pose is not None:
            return nearest_node(graph, self.pose, costmap)
        if self.id not in graph.nodes:
            raise NavigationError('INDETERMINANT_NODES_ON_GRAPH', f'the graph has no node {self.id}')
        return graph.nodes[self.id]


@dataclass(frozen=True)
class RouteProgress:
    """The progress of the robot when its route is planned again.

    ``blocked`` are ids of edges that cannot be used. ``node`` was achieved last, if any was, and ``edge`` is the one
    that the robot is on, at ``pose``.
    """

    blocked: frozenset[int] = frozenset()
    node: RouteNode | None = None
    edge: RouteEdge | None = None
    pose: Pose | None = None


@dataclass(frozen=True)
class PlannedRoute:
    """``edge`` is the one that the robot is on already, on its way to the first node of the route."""

    route: Route
    path: list[Pose]
    edge: RouteEdge | None = None


@dataclass(frozen=True)
class RoutePlanner:
    """A planner on one graph. If there is a ``costmap``, it is checked for obstacles."""

    graph: RouteGraph
    score: Scorer
    shape: PathShape
    costmap: Costmap | None = None

    def plan(
        self,
        start: Ends,
        goal: Ends,
        progress: RouteProgress | None = None,
        check_time: Callable[[], None] = lambda: None,
    ) -> PlannedRoute:
        """Return a route from start to goal; ``progress`` when there was another one before.

        Raises:
            NavigationError: INDETERMINANT_NODES_ON_GRAPH, NO_VALID_ROUTE, NO_VALID_GRAPH, INVALID_EDGE_SCORER_USE, or
                what ``check_time`` raises.
        """
        last = goal.node(self.graph, self.costmap)
        was_on: RouteEdge | None = None
        blocked: frozenset[int] = frozenset()
        place = start.pose
        first: RouteNode | None = None
        if progress is not None:
            blocked, was_on = progress.blocked, progress.edge
            if progress.node is not None:
                first, place = self.graph.nodes.get(progress.node.id), progress.pose
        first = first or start.node(self.graph, self.costmap)
        start_pose = place if goal.pose is not None else None
        request = RouteRequest(first, last, start_pose, goal.pose, self.costmap)
        whole = find_route(self.graph, request, self.score, blocked, check_time)
        route = pruned(
            whole, place[:2] if place is not None else None, goal.pose[:2] if goal.pose is not None else None
        )
        edge = None
        if was_on is not None and whole.edges and whole.edges[0].id == was_on.id and route.start is not whole.start:
            edge = whole.edges[0]
        begin = (
            closest_point(place[:2], edge.start.point, edge.end.point)
            if edge is not None and place is not None
            else None
        )
        return PlannedRoute(route, route_path(route, self.shape, begin), edge)


# Poses that routes are asked for, and the nodes for them: what Nav2's goal intent extractor does.

NEAREST_NODES: Final = 5
MOST_CELLS: Final = 10_000
"""Maximum number of nodes that are tried for a pose, and of cells: Nav2's num_nearest_nodes and
max_nn_search_iterations."""

FARTHEST_FROM_EDGE: Final = 8.0
LEAST_FROM_START: Final = 0.10
LEAST_FROM_GOAL: Final = 0.15
"""Distances at which an end of a route is left out, m: max_prune_dist_from_edge, min_prune_dist_from_start and
_goal."""


def nearest_node(graph: RouteGraph, pose: Pose, costmap: Costmap | None) -> RouteNode:
    """Return the nearest node; of the five nearest the one with the shortest free way, when something is in between."""
    nodes = graph.nearest(pose, NEAREST_NODES)
    if costmap is None:
        return nodes[0]
    costs, is_on_map = line_costs(costmap, pose[:2], nodes[0].point)
    if not is_on_map or costs.max() < INSCRIBED:
        return nodes[0]
    world = costmap.world
    wanted = {world.cell(*node.point): node for node in reversed(nodes)}
    return _first_reached(costmap, world.cell(pose.x, pose.y), wanted) or nodes[0]


def _first_reached(
    costmap: Costmap, start: tuple[int, int], wanted: dict[tuple[int, int], RouteNode]
) -> RouteNode | None:
    """Return the node at the first of the wanted cells to which the free cells lead, by breadth-first search."""
    seen = {start}
    queue = deque([start])
    for _ in range(MOST_CELLS):
        if not queue:
            return None
        row, column = cell = queue.popleft()
        if cell in wanted:
            return wanted[cell]
        for up, right in product((-1, 0, 1), repeat=2):
            next_cell = row + up, column + right
            if next_cell not in seen and costmap.world.contains(*next_cell) and costmap.costs[next_cell] < INSCRIBED:
                seen.add(next_cell)
                queue.append(next_cell)
    return None


def pruned(route: Route, start: Point | None, goal: Point | None) -> Route:
    """Without its first edge when the start is on it already, and without its last one when the goal comes before.

    A place that is None prunes nothing.
    """
    if start is not None and route.edges:
        first, next_node = route.start.point, route.edges[0].end
        beyond = _along(first, next_node.point, first, start)
        if beyond > 0.0 and _is_beside(start, first, next_node.point, first, LEAST_FROM_START):
            route = Route(next_node, route.edges[1:], route.costs[1:])
    if goal is not None and route.edges:
        edge = route.edges[-1]
        beyond = _along(edge.start.point, edge.end.point, edge.end.point, goal)
        if beyond < 0.0 and _is_beside(goal, edge.start.point, edge.end.point, edge.end.point, LEAST_FROM_GOAL):
            route = replace(route, edges=route.edges[:-1], costs=route.costs[:-1])
    return route


def _along(start: Point, end: Point, origin: Point, place: Point) -> float:
    """Return whether a place lies ahead of an origin in the direction of a line (more than 0), or behind it."""
    value = cosine(end[0] - start[0], end[1] - start[1], place[0] - origin[0], place[1] - origin[1])
    return value if abs(value) > 1e-6 else 0.0


def _is_beside(place: Point, start: Point, end: Point, node: Point, least: float) -> bool:
    """Return whether a place is near enough to an edge, and not at its node."""
    near = math.dist(closest_point(place, start, end), place) <= FARTHEST_FROM_EDGE
    return near and math.dist(place, node) > least
