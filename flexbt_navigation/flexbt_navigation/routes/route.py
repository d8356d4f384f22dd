# SPDX-License-Identifier: BSD-3-Clause
"""Routes: planning and replanning the cheapest route of a request through a graph; its path; and the progress of the
robot on it."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Collection
from dataclasses import dataclass, replace
from itertools import pairwise, product
from typing import Final

import numpy

from flexbt_core.values.parameter_fields import parameter
from flexbt_navigation.costmaps.costmap import INSCRIBED, Costmap
from flexbt_navigation.errors import NavigationError
from flexbt_sim.world.plane.geometry import Point, Pose

from .edge_scorers import RouteRequest, Scorer, closest_point, cosine, greatest_cost
from .graph import Operation, RouteEdge, RouteGraph, RouteNode


@dataclass(frozen=True)
class Route:
    """A route from a node over edges; ``costs`` are those of the edges. Without edges, the route is the node alone."""

    start: RouteNode
    edges: tuple[RouteEdge, ...] = ()
    costs: tuple[float, ...] = ()

    @property
    def nodes(self) -> tuple[RouteNode, ...]:
        """Nodes of the route, one more than edges."""
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
    """Return the cheapest route. It uses no edge and no node whose id is in ``blocked``.

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
    # Nav2's search examines all edges of a node that is nearer than the goal, including those that lead back.
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


# Routes as dense paths with rounded corners, like Nav2's path converter.


@dataclass(frozen=True)
class PathShape:
    """The shape of paths along routes."""

    density: float = parameter('path_density', 0.05, "greatest distance of the poses of a route's path, m", 0.01, 10.0)
    radius: float = parameter('smoothing_radius', 1.0, "radius of the corners of a route's path, m", 0.01, 100.0)
    is_rounded: bool = parameter('smooth_corners', True, "whether the corners of a route's path are rounded")


def route_path(route: Route, shape: PathShape, begin: Point | None = None) -> list[Pose]:
    """Return the poses along a route. Each heads to the next, and the last has the heading of its edge.

    ``begin`` is the position of the robot on the edge to the first node, if it is on its way there. A corner is not
    rounded if its edges are too short for the arc.
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
    """Return points from start to just before end."""
    count = math.ceil(math.dist(start, end) / density)
    return [
        (start[0] + (end[0] - start[0]) * step / count, start[1] + (end[1] - start[1]) * step / count)
        for step in range(count)
    ]


def _arc(start: Point, corner: Point, end: Point, shape: PathShape) -> list[Point]:
    """Return points of the arc that touches both lines of a corner, or the corner itself."""
    before, after = math.dist(start, corner), math.dist(corner, end)
    if not (shape.is_rounded and before and after):
        return [corner]
    ax, ay = (start[0] - corner[0]) / before, (start[1] - corner[1]) / before
    bx, by = (end[0] - corner[0]) / after, (end[1] - corner[1]) / after
    angle = math.atan2(abs(ax * by - ay * bx), ax * bx + ay * by)
    if angle < 1e-6 or math.pi - angle < 1e-6:  # straight back, or straight ahead
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


@dataclass(frozen=True)
class Ends:
    """One end of a route: a node of the graph by its id, or a pose."""

    id: int = 0
    pose: Pose | None = None

    def node(self, graph: RouteGraph, costmap: Costmap | None) -> RouteNode:
        """Return the node for this end. Raises NavigationError INDETERMINANT_NODES_ON_GRAPH."""
        if self.pose is not None:
            return nearest_node(graph, self.pose, costmap)
        if self.id not in graph.nodes:
            raise NavigationError('INDETERMINANT_NODES_ON_GRAPH', f'the graph has no node {self.id}')
        return graph.nodes[self.id]


@dataclass(frozen=True)
class RouteProgress:
    """The progress of the robot when its route is replanned.

    ``blocked`` are ids of edges that cannot be used. ``node`` is the last achieved node, if any, and ``edge`` the edge
    that the robot is on, at ``pose``.
    """

    blocked: frozenset[int] = frozenset()
    node: RouteNode | None = None
    edge: RouteEdge | None = None
    pose: Pose | None = None


@dataclass(frozen=True)
class PlannedRoute:
    """A route with its path. ``edge`` is the edge that the robot is already on, on its way to the first node."""

    route: Route
    path: list[Pose]
    edge: RouteEdge | None = None


MOST_POSES: Final = 100_000
"""Maximum number of poses of a path. A graph with places of another coordinate system has edges across the world."""


@dataclass(frozen=True)
class RoutePlanner:
    """A planner on one graph. If it has a ``costmap``, it checks it for obstacles."""

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
        """Return a route from start to goal; ``progress`` is that on the previous route, if any.

        Raises:
            NavigationError: INDETERMINANT_NODES_ON_GRAPH, NO_VALID_ROUTE (also for a path of too many poses),
                NO_VALID_GRAPH, INVALID_EDGE_SCORER_USE, or what ``check_time`` raises.
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
        length = sum(edge.length for edge in whole.edges)
        if length > MOST_POSES * self.shape.density:
            raise NavigationError(
                'NO_VALID_ROUTE',
                f'the route is {length:g} m long, and its path would have more than {MOST_POSES} poses; '
                'see that the graph has coordinates of one system, or give a greater path_density',
            )
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


# Nodes for the poses of a request, like Nav2's goal intent extractor.

NEAREST_NODES: Final = 5
MOST_CELLS: Final = 10_000
"""Maximum number of nodes that are tried for a pose, and of cells that are searched: Nav2's num_nearest_nodes and
max_nn_search_iterations."""

FARTHEST_FROM_EDGE: Final = 8.0
LEAST_FROM_START: Final = 0.10
LEAST_FROM_GOAL: Final = 0.15
"""Distances for pruning an end of a route, m: max_prune_dist_from_edge, min_prune_dist_from_start and _goal."""


def nearest_node(graph: RouteGraph, pose: Pose, costmap: Costmap | None) -> RouteNode:
    """Return the nearest node or, if an obstacle is in between, the one of the five nearest with the shortest free
    path."""
    nodes = graph.nearest(pose, NEAREST_NODES)
    if costmap is None:
        return nodes[0]
    cost, is_on_map = greatest_cost(costmap, pose[:2], nodes[0].point)
    if not is_on_map or cost < INSCRIBED:
        return nodes[0]
    world = costmap.world
    wanted = {world.cell(*node.point): node for node in reversed(nodes)}
    return _first_reached(costmap, world.cell(pose.x, pose.y), wanted) or nodes[0]


def _first_reached(
    costmap: Costmap, start: tuple[int, int], wanted: dict[tuple[int, int], RouteNode]
) -> RouteNode | None:
    """Return the node of the first wanted cell that a breadth-first search over free cells reaches."""
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
    """Return the route without its first edge if the start is already on it, and without its last edge if the goal lies
    before its end.

    A place of None prunes nothing.
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
    """Return a number above 0 if a place lies ahead of an origin in the direction of a line, below 0 if behind."""
    value = cosine(end[0] - start[0], end[1] - start[1], place[0] - origin[0], place[1] - origin[1])
    return value if abs(value) > 1e-6 else 0.0


def _is_beside(place: Point, start: Point, end: Point, node: Point, least: float) -> bool:
    """Return whether a place is near an edge, but not at its node."""
    near = math.dist(closest_point(place, start, end), place) <= FARTHEST_FROM_EDGE
    return near and math.dist(place, node) > least


@dataclass(frozen=True)
class AchievedRadii:
    """Distances, m, within which a node counts as achieved: on the way, and at the ends of the route."""

    node: float = parameter('radius_to_achieve_node', 2.0, 'how near to a node it may be achieved, m', 0.01, 100.0)
    boundary: float = parameter(
        'boundary_radius_to_achieve_node', 1.0, 'the same for the first and the last node, m', 0.01, 100.0
    )


class RouteTracker:
    """A tracker of the robot on a route. ``last_node`` is the last achieved node, ``next_node`` the one ahead, and
    ``edge`` the edge between them."""

    def __init__(self, route: Route, radii: AchievedRadii, edge: RouteEdge | None = None) -> None:
        """``edge`` is the edge to the first node if the robot is already on it, after the route has changed."""
        self.route = route
        self.edge = edge
        self.left: RouteEdge | None = None
        self.last_node: RouteNode | None = edge.start if edge is not None else None
        self.next_node: RouteNode | None = route.start
        self._radii = radii
        self._index = -1
        self._was_near = False

    @property
    def is_complete(self) -> bool:
        """True if the last node of the route was achieved."""
        return self.next_node is None

    def step(self, pose: Pose) -> bool:
        """Return whether the robot has achieved the next node. If so, advance to the node after it, or complete the
        route."""
        node = self.next_node
        if node is None or not self._is_achieved(pose, node):
            return False
        edges = self.route.edges
        self._was_near = False
        self._index += 1
        self.left, self.last_node = self.edge, node
        self.edge = edges[self._index] if self._index < len(edges) else None
        self.next_node = self.edge.end if self.edge is not None else None
        return True

    @property
    def edges_after(self) -> tuple[RouteEdge, ...]:
        """Edges after the current one."""
        return self.route.edges[self._index + 1 :]

    def operations(self) -> list[Operation]:
        """Return the operations of the graph at the node that was just achieved."""
        places = ((self.last_node, 'NODE'), (self.edge, 'ON_ENTER'), (self.left, 'ON_EXIT'))
        return [
            operation
            for place, trigger in places
            if place is not None
            for operation in place.operations
            if operation.trigger == trigger
        ]

    def _is_achieved(self, pose: Pose, node: RouteNode) -> bool:
        dx, dy = node.x - pose.x, node.y - pose.y
        distance = math.hypot(dx, dy)
        is_boundary = self._index == len(self.route.edges) - 1 or self.edge is None
        is_near = distance <= (self._radii.boundary if is_boundary else self._radii.node)
        if distance < 1e-4 or (self._was_near and not is_near):
            return True
        self._was_near = is_near
        if is_boundary or not is_near or self.edge is None:
            return is_near
        # The robot has passed the line through the node that bisects the angle between this edge and the next.
        before, after = self.edge, self.route.edges[self._index + 1]
        n, m = before.length, after.length
        if min(n, m) < 1e-6:
            return True
        bx = (node.x - before.start.x) / n + (after.end.x - node.x) / m
        by = (node.y - before.start.y) / n + (after.end.y - node.y) / m
        return cosine(bx, by, dx, dy) <= 0.0


def blocked_edge(tracker: RouteTracker, pose: Pose, costmap: Costmap, distance: float) -> RouteEdge | None:
    """Return the first edge within this distance ahead, m, on which the robot would collide: Nav2's CollisionMonitor.

    The check ends at the border of the map.
    """
    edge = tracker.edge
    if edge is None:
        return None
    here = closest_point(pose[:2], edge.start.point, edge.end.point)
    for each in (edge, *tracker.edges_after):
        end = each.end.point
        length = math.dist(here, end)
        if length > distance:
            part = distance / length
            end = here[0] + (end[0] - here[0]) * part, here[1] + (end[1] - here[1]) * part
        cost, is_on_map = greatest_cost(costmap, here, end)
        if cost >= INSCRIBED:
            return each
        distance -= length
        if distance <= 0.0 or not is_on_map:
            return None
        here = end
    return None
