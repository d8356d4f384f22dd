# SPDX-License-Identifier: BSD-3-Clause
"""What edges cost: the edge cost functions of Nav2's route server, with its default weights.

A scorer gives the cost of an edge, or None when the edge must not be used. The costs of several are added up.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from typing import Final

from flexbt_sim.errors import NavigationError
from flexbt_sim.navigation import INSCRIBED, Costmap
from flexbt_sim.world import Pose, wrap

from .graph import RouteEdge, RouteNode, number, speed_limit
from .lines import line_costs

GREATEST_SPEED: Final = 0.5
"""m/s, where no speed is given: max_vel of Nav2's TimeScorer."""


@dataclass(frozen=True)
class RouteRequest:
    """Between which nodes a route is wanted; poses are given when the request has them."""

    start: RouteNode
    goal: RouteNode
    start_pose: Pose | None = None
    goal_pose: Pose | None = None
    costmap: Costmap | None = None


@dataclass
class DynamicEdges:
    """Edges that were closed, or made dearer, at run time: Nav2's DynamicEdgesScorer."""

    closed: set[int] = field(default_factory=set)
    costs: dict[int, float] = field(default_factory=dict)

    def adjust(self, closed: Iterable[int], opened: Iterable[int], costs: Mapping[int, float]) -> None:
        """Close edges, open edges, and give edges costs that are added to what they cost."""
        self.closed.update(closed)
        self.closed.difference_update(opened)
        self.costs.update(costs)

    def score(self, edge: RouteEdge, _request: RouteRequest) -> float | None:
        return None if edge.id in self.closed else self.costs.get(edge.id, 0.0)


Scorer = Callable[[RouteEdge, RouteRequest], float | None]


def _distance(edge: RouteEdge, _request: RouteRequest) -> float:
    """Length, m, longer where the speed is limited."""
    return edge.length / speed_limit(edge)


def _time(edge: RouteEdge, _request: RouteRequest) -> float:
    """Seconds: those that it took the last time, or those at the speed that is given, or at the greatest one."""
    taken, speed = number(edge, 'abs_time_taken'), number(edge, 'abs_speed_limit')
    if taken is not None and taken > 0.0:
        return taken
    return edge.length / (speed if speed is not None and speed > 0.0 else GREATEST_SPEED)


def _penalty(edge: RouteEdge, _request: RouteRequest) -> float:
    return number(edge, 'penalty') or 0.0


def _costmap(edge: RouteEdge, request: RouteRequest) -> float | None:
    """The greatest cost on the edge as a part of that of a collision; none in a collision, or beside the map."""
    if request.costmap is None:
        return None
    costs, is_on_map = line_costs(request.costmap, edge.start.point, edge.end.point)
    return None if not is_on_map or costs.max() >= INSCRIBED else float(costs.max()) / INSCRIBED


def _start_orientation(edge: RouteEdge, request: RouteRequest) -> float:
    """How much the first edge turns away from the heading of the start, rad."""
    return _turn(edge, _given(request.start_pose, 'StartPoseOrientationScorer'), edge.start is request.start)


def _goal_orientation(edge: RouteEdge, request: RouteRequest) -> float:
    """How much the last edge turns away from the heading of the goal, rad."""
    return _turn(edge, _given(request.goal_pose, 'GoalPoseOrientationScorer'), edge.end is request.goal)


def _given(pose: Pose | None, scorer: str) -> Pose:
    if pose is None:
        raise NavigationError('INVALID_EDGE_SCORER_USE', f'{scorer} needs poses; the request has node ids')
    return pose


def _turn(edge: RouteEdge, pose: Pose, counts: bool) -> float:
    return abs(wrap(edge.heading - pose.yaw)) if counts else 0.0


SCORERS: Final[Mapping[str, Scorer]] = {
    'DistanceScorer': _distance,
    'TimeScorer': _time,
    'PenaltyScorer': _penalty,
    'CostmapScorer': _costmap,
    'StartPoseOrientationScorer': _start_orientation,
    'GoalPoseOrientationScorer': _goal_orientation,
}
"""By Nav2's names; beside them there is the DynamicEdgesScorer, :class:`DynamicEdges`."""


def edge_scorer(scorers: Iterable[Scorer]) -> Scorer:
    """What an edge costs by several scorers, never less than 0.

    Raises, when called:
        NavigationError: NO_VALID_GRAPH for an edge with a cost of its own that is not positive.
    """
    scorers = tuple(scorers)

    def score(edge: RouteEdge, request: RouteRequest) -> float | None:
        if not edge.overridable or not scorers:
            if edge.cost <= 0.0:
                raise NavigationError(
                    'NO_VALID_GRAPH', f'edge {edge.id} has the cost {edge.cost:g}, which nothing overrides; give more'
                )
            return edge.cost
        total = 0.0
        for scorer in scorers:
            cost = scorer(edge, request)
            if cost is None:
                return None
            total += cost
        return max(0.0, total)

    return score
