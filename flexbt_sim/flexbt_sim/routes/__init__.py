# SPDX-License-Identifier: BSD-3-Clause
"""Routes on a graph of places: what Nav2's route server plans and tracks. Pure."""

from .edge_scorers import SCORERS, DynamicEdges, RouteRequest, Scorer, edge_scorer
from .geojson import load_graph
from .graph import Operation, RouteEdge, RouteGraph, RouteNode, speed_limit
from .lines import closest_point, line_costs
from .request_nodes import nearest_node, pruned
from .route import Route, find_route
from .route_path import PathShape, route_path
from .route_planner import Ends, PlannedRoute, Progress, RoutePlanner
from .tracker import AchievedRadii, RouteTracker, blocked_edge

__all__ = [
    'SCORERS',
    'AchievedRadii',
    'DynamicEdges',
    'Ends',
    'Operation',
    'PathShape',
    'PlannedRoute',
    'Progress',
    'Route',
    'RouteEdge',
    'RouteGraph',
    'RouteNode',
    'RoutePlanner',
    'RouteRequest',
    'RouteTracker',
    'Scorer',
    'blocked_edge',
    'closest_point',
    'edge_scorer',
    'find_route',
    'line_costs',
    'load_graph',
    'nearest_node',
    'pruned',
    'route_path',
    'speed_limit',
]
