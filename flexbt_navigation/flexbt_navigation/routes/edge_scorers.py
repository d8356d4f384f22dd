# SPDX-License-Identifier: BSD-3-Clause
"""Costs of edges, by the edge cost functions of Nav2's route server with its default weights; and costs of straight
lines.

A scorer returns the costs of all edges of a graph, infinite for edges that must not be used. The costs of several
scorers are added.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Final, Protocol

import numpy
from numpy.typing import NDArray

from flexbt_navigation.costmaps.costmap import INSCRIBED, Costmap
from flexbt_navigation.errors import NavigationError
from flexbt_sim.world.plane.geometry import Point, Pose, wrap

from .graph import RouteEdge, RouteGraph, RouteNode, number, speed_limit

Places = NDArray[numpy.float64]

CELLS_AT_A_TIME: Final = 1_000_000
"""Number of cells per block; larger blocks are no faster and use more memory."""


def greatest_cost(costmap: Costmap, start: Point, end: Point) -> tuple[float, bool]:
    """Return the greatest cost on the part of a line that is on the map, and whether the whole line is."""
    greatest, is_on_map = greatest_costs(costmap, numpy.array([start]), numpy.array([end]))
    return float(greatest[0]), bool(is_on_map[0])


def greatest_costs(
    costmap: Costmap, starts: NDArray[numpy.float64], ends: NDArray[numpy.float64]
) -> tuple[NDArray[numpy.float64], NDArray[numpy.bool_]]:
    """Return, for each of many lines, N x 2, m, its greatest cost and whether it is on the map."""
    world = costmap.world
    begin, end = (numpy.stack(world.grid_position(*points.T), axis=1) for points in (starts, ends))
    # Of a line that is much longer than the map, look at its part there: nodes may be thousands of kilometres away.
    is_far = numpy.hypot(*(end - begin).T) > 2.0 * (world.height + world.width)
    begin[is_far], end[is_far] = _clipped(begin[is_far], end[is_far], (world.height, world.width))
    counts = numpy.maximum(1, numpy.ceil(2.0 * numpy.hypot(*(end - begin).T))).astype(int)
    greatest, is_on_map = numpy.zeros(len(counts)), numpy.ones(len(counts), bool)
    pieces = numpy.flatnonzero(numpy.diff(numpy.cumsum(counts + 1) // CELLS_AT_A_TIME)) + 1
    for lines in numpy.split(numpy.arange(len(counts)), pieces):
        points = counts[lines] + 1
        last = numpy.cumsum(points) - 1
        first = last - counts[lines]
        steps = numpy.arange(points.sum()) - numpy.repeat(first, points)
        places = numpy.repeat(begin[lines], points, axis=0)
        places += steps[:, None] * numpy.repeat((end[lines] - begin[lines]) / counts[lines, None], points, axis=0)
        places[last] = end[lines]
        rows, columns = numpy.floor(places).astype(int).T
        inside = (rows >= 0) & (rows < world.height) & (columns >= 0) & (columns < world.width)
        costs = numpy.zeros(len(rows), numpy.uint8)
        costs[inside] = costmap.costs[rows[inside], columns[inside]]
        greatest[lines] = numpy.maximum.reduceat(costs, first)
        is_on_map[lines] = numpy.logical_and.reduceat(inside, first)
    return greatest, is_on_map & ~is_far


def _clipped(begin: Places, end: Places, size: tuple[int, int]) -> tuple[Places, Places]:
    """Return the ends of the parts of lines, N x 2, in cells, that are on a grid; a point beside it for a line that
    does not meet it."""
    way = numpy.where(end == begin, 1e-300, end - begin)
    crossed = numpy.sort([-begin / way, (numpy.array(size) - begin) / way], axis=0)
    first = numpy.clip(crossed[0].max(axis=1), 0.0, 1.0)[:, None]
    last = numpy.clip(crossed[1].min(axis=1), -1.0, 1.0)[:, None]
    meets = first <= last
    return numpy.where(meets, begin + first * way, -1.0), numpy.where(meets, begin + last * way, -1.0)


def closest_point(place: Point, start: Point, end: Point) -> Point:
    """Return the point of the line from start to end that is closest to a place."""
    dx, dy = end[0] - start[0], end[1] - start[1]
    square = dx * dx + dy * dy
    part = ((place[0] - start[0]) * dx + (place[1] - start[1]) * dy) / square if square else 0.0
    part = min(1.0, max(0.0, part))
    return start[0] + part * dx, start[1] + part * dy


def cosine(ax: float, ay: float, bx: float, by: float) -> float:
    """Return the cosine of the angle between two vectors; 0 if one of them has no direction."""
    lengths = math.hypot(ax, ay) * math.hypot(bx, by)
    return (ax * bx + ay * by) / lengths if lengths > 1e-12 else 0.0


GREATEST_SPEED: Final = 0.5
"""Speed, m/s, of an edge without one: max_vel of Nav2's TimeScorer."""


@dataclass(frozen=True)
class RouteRequest:
    """The start and goal nodes of a requested route, with their poses if the request has them."""

    start: RouteNode
    goal: RouteNode
    start_pose: Pose | None = None
    goal_pose: Pose | None = None
    costmap: Costmap | None = None


Costs = NDArray[numpy.float64]
"""Costs of the edges of a graph, in their order; infinite for one that must not be used."""


class Scorer(Protocol):
    """Costs of the edges of a graph for a request."""

    def __call__(self, graph: RouteGraph, request: RouteRequest, /) -> Costs:
        """Return the costs of all edges. Raises NavigationError INVALID_EDGE_SCORER_USE."""


@dataclass
class DynamicEdges:
    """Edges that were closed, or made dearer, at run time: Nav2's DynamicEdgesScorer.

    They may be adjusted while another thread scores: an adjustment replaces the data, it does not modify it.
    """

    closed: frozenset[int] = frozenset()
    costs: Mapping[int, float] = field(default_factory=dict)

    def adjust(self, closed: Iterable[int], opened: Iterable[int], costs: Mapping[int, float]) -> None:
        """Close edges, open edges, and set costs that are added to those of edges."""
        self.closed = self.closed.union(closed).difference(opened)
        self.costs = {**self.costs, **costs}

    def __call__(self, graph: RouteGraph, _request: RouteRequest) -> Costs:
        ids = graph.links.edge_ids
        costs = numpy.zeros(len(ids))
        for id, cost in self.costs.items():
            costs[ids == id] = cost
        costs[numpy.isin(ids, list(self.closed))] = numpy.inf
        return costs


def _distance(graph: RouteGraph, _request: RouteRequest) -> Costs:
    return graph.of_edges(_length)


def _time(graph: RouteGraph, _request: RouteRequest) -> Costs:
    return numpy.array([_seconds(edge) for edge in graph.edges], float)


def _penalty(graph: RouteGraph, _request: RouteRequest) -> Costs:
    return graph.of_edges(_penalty_of)


def _length(edge: RouteEdge) -> float:
    """Return the length, m, longer where the speed is limited."""
    return edge.length / speed_limit(edge)


def _seconds(edge: RouteEdge) -> float:
    """Return the time for an edge, s: that of the last time, or else at the speed of the edge or the greatest speed."""
    taken, speed = number(edge, 'abs_time_taken'), number(edge, 'abs_speed_limit')
    if taken is not None and taken > 0.0:
        return taken
    return edge.length / (speed if speed is not None and speed > 0.0 else GREATEST_SPEED)


def _penalty_of(edge: RouteEdge) -> float:
    return number(edge, 'penalty') or 0.0


def _costmap(graph: RouteGraph, request: RouteRequest) -> Costs:
    """Return the greatest cost on each edge as a fraction of that of a collision; infinite in a collision or outside
    the map."""
    if request.costmap is None:
        return numpy.full(len(graph.edges), numpy.inf)
    greatest, is_on_map = greatest_costs(
        request.costmap,
        numpy.array([edge.start.point for edge in graph.edges], float).reshape(-1, 2),
        numpy.array([edge.end.point for edge in graph.edges], float).reshape(-1, 2),
    )
    return numpy.where(is_on_map & (greatest < INSCRIBED), greatest / INSCRIBED, numpy.inf)


def _start_orientation(graph: RouteGraph, request: RouteRequest) -> Costs:
    """Return the angle, rad, from the heading of the start to each first edge."""
    return _turns(graph, _given(request.start_pose, 'StartPoseOrientationScorer'), graph.links.starts, request.start)


def _goal_orientation(graph: RouteGraph, request: RouteRequest) -> Costs:
    """Return the angle, rad, from the heading of the goal to each last edge."""
    return _turns(graph, _given(request.goal_pose, 'GoalPoseOrientationScorer'), graph.links.ends, request.goal)


def _given(pose: Pose | None, scorer: str) -> Pose:
    if pose is None:
        raise NavigationError('INVALID_EDGE_SCORER_USE', f'{scorer} needs poses; the request has node ids')
    return pose


def _turns(graph: RouteGraph, pose: Pose, nodes: NDArray[numpy.int64], node: RouteNode) -> Costs:
    """Return, for each edge at this node, the angle, rad, by which a robot at a pose turns to it; 0 for other edges."""
    costs = numpy.zeros(len(graph.edges))
    for index in numpy.flatnonzero(nodes == graph.links.index[node.id]):
        costs[index] = abs(wrap(graph.edges[index].heading - pose.yaw))
    return costs


SCORERS: Final[Mapping[str, Scorer]] = {
    'DistanceScorer': _distance,
    'TimeScorer': _time,
    'PenaltyScorer': _penalty,
    'CostmapScorer': _costmap,
    'StartPoseOrientationScorer': _start_orientation,
    'GoalPoseOrientationScorer': _goal_orientation,
}
"""Scorers by Nav2's names. The DynamicEdgesScorer is :class:`DynamicEdges`."""


def edge_scorer(scorers: Iterable[Scorer]) -> Scorer:
    """Return a scorer that adds the costs of several scorers, at least 0. An edge that is not overridable, or any edge
    if no scorers are given, has its own cost, or NaN if that is not positive."""
    scorers = tuple(scorers)

    def score(graph: RouteGraph, request: RouteRequest) -> Costs:
        own = graph.of_edges(_own_cost)
        if not scorers:
            return numpy.where(own > 0.0, own, numpy.nan)
        total = numpy.sum([scorer(graph, request) for scorer in scorers], axis=0)
        is_fixed = graph.of_edges(_is_fixed) > 0.0
        return numpy.where(is_fixed, numpy.where(own > 0.0, own, numpy.nan), numpy.maximum(0.0, total))

    return score


def _own_cost(edge: RouteEdge) -> float:
    return edge.cost


def _is_fixed(edge: RouteEdge) -> float:
    return not edge.overridable
