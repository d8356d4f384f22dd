# SPDX-License-Identifier: BSD-3-Clause
"""Progress of the robot on its route: Nav2's route tracker."""

from __future__ import annotations

import math
from dataclasses import dataclass

from flexbt_core.values.parameter_fields import parameter
from flexbt_navigation.costmaps.costmap import INSCRIBED, Costmap
from flexbt_sim.world.plane.geometry import Pose

from .graph import Operation, RouteEdge, RouteNode
from .lines import closest_point, cosine, line_costs
from .route import Route


@dataclass(frozen=True)
class AchievedRadii:
    """Within how many m of a node it may be achieved: on the way, and at the ends of the route."""

    node: float = parameter('radius_to_achieve_node', 2.0, 'how near to a node it may be achieved, m', 0.01, 100.0)
    boundary: float = parameter(
        'boundary_radius_to_achieve_node', 1.0, 'the same for the first and the last node, m', 0.01, 100.0
    )


class RouteTracker:
    """``last_node`` is the one that was achieved last, ``next_node`` the one ahead, ``edge`` that between them."""

    def __init__(self, route: Route, radii: AchievedRadii, edge: RouteEdge | None = None) -> None:
        """``edge`` is the one to the first node when the robot is on it already, after the route has changed."""
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
        """True if the last node was achieved."""
        return self.next_node is None

    def step(self, pose: Pose) -> bool:
        """Return whether the next node is achieved. Then the one after it is the next one, or the route is complete."""
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
        """Return those of the graph at the place where a node was just achieved."""
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
        # Past the line through the node that halves the angle between this edge and the next one.
        before, after = self.edge, self.route.edges[self._index + 1]
        n, m = before.length, after.length
        if min(n, m) < 1e-6:
            return True
        bx = (node.x - before.start.x) / n + (after.end.x - node.x) / m
        by = (node.y - before.start.y) / n + (after.end.y - node.y) / m
        return cosine(bx, by, dx, dy) <= 0.0


def blocked_edge(tracker: RouteTracker, pose: Pose, costmap: Costmap, distance: float) -> RouteEdge | None:
    """Return the first edge within this distance ahead, m, on which the robot would collide: Nav2's CollisionMonitor.

    The map ends that: what is beyond cannot be known.
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
        costs, is_on_map = line_costs(costmap, here, end)
        if costs.max() >= INSCRIBED:
            return each
        distance -= length
        if distance <= 0.0 or not is_on_map:
            return None
        here = end
    return None
