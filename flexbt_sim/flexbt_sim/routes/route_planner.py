# SPDX-License-Identifier: BSD-3-Clause
"""From a request to a route and its path, the first time and whenever the route has to be another one."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from flexbt_sim.costmaps import Costmap
from flexbt_sim.navigation_errors import NavigationError
from flexbt_sim.world import Pose

from .edge_scorers import RouteRequest, Scorer
from .graph import RouteEdge, RouteGraph, RouteNode
from .lines import closest_point
from .request_nodes import nearest_node, pruned
from .route import Route, find_route
from .route_path import PathShape, route_path


@dataclass(frozen=True)
class Ends:
    """Where a route begins, or ends: a node of the graph by its id, or a pose."""

    id: int = 0
    pose: Pose | None = None

    def node(self, graph: RouteGraph, costmap: Costmap | None) -> RouteNode:
        """Raises NavigationError INDETERMINANT_NODES_ON_GRAPH."""
        if self.pose is not None:
            return nearest_node(graph, self.pose, costmap)
        if self.id not in graph.nodes:
            raise NavigationError('INDETERMINANT_NODES_ON_GRAPH', f'the graph has no node {self.id}')
        return graph.nodes[self.id]


@dataclass(frozen=True)
class Progress:
    """How far the robot is when its route has to be another one.

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
    """Plans on one graph. ``costmap`` is looked at where something may be in the way, when there is one."""

    graph: RouteGraph
    score: Scorer
    shape: PathShape
    costmap: Costmap | None = None

    def plan(
        self,
        start: Ends,
        goal: Ends,
        progress: Progress | None = None,
        check_time: Callable[[], None] = lambda: None,
    ) -> PlannedRoute:
        """A route from start to goal; ``progress`` when there was another one before.

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
