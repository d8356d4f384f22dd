# SPDX-License-Identifier: BSD-3-Clause
"""Poses that routes are asked for, and the nodes for them: what Nav2's goal intent extractor does."""

from __future__ import annotations

import math
from collections import deque
from dataclasses import replace
from itertools import product
from typing import Final

from flexbt_sim.costmaps import INSCRIBED, Costmap
from flexbt_sim.world import Point, Pose

from .graph import RouteGraph, RouteNode
from .lines import closest_point, cosine, line_costs
from .route import Route

NEAREST_NODES: Final = 5
MOST_CELLS: Final = 10_000
"""How many nodes are tried for a pose, and how many cells: Nav2's num_nearest_nodes and max_nn_search_iterations."""

FARTHEST_FROM_EDGE: Final = 8.0
LEAST_FROM_START: Final = 0.10
LEAST_FROM_GOAL: Final = 0.15
"""When an end of a route is left out, m: max_prune_dist_from_edge, min_prune_dist_from_start and _goal."""


def nearest_node(graph: RouteGraph, pose: Pose, costmap: Costmap | None) -> RouteNode:
    """The nearest node; of the five nearest the one with the shortest free way, when something is in between."""
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
    """The node at the first of the wanted cells to which the free cells lead, by breadth-first search."""
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
    """Whether a place lies ahead of an origin in the direction of a line (more than 0), or behind it."""
    value = cosine(end[0] - start[0], end[1] - start[1], place[0] - origin[0], place[1] - origin[1])
    return value if abs(value) > 1e-6 else 0.0


def _is_beside(place: Point, start: Point, end: Point, node: Point, least: float) -> bool:
    """Whether a place is near enough to an edge, and not at its node."""
    near = math.dist(closest_point(place, start, end), place) <= FARTHEST_FROM_EDGE
    return near and math.dist(place, node) > least
