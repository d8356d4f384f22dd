# SPDX-License-Identifier: BSD-3-Clause
"""The parameters of the route server, with Nav2's names."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Final

from flexbt_core.values.parameter_fields import parameter

from .edge_scorers import SCORERS
from .route import PathShape
from .tracker import AchievedRadii

DYNAMIC_EDGES: Final = 'DynamicEdgesScorer'
ADJUST_SPEED_LIMIT: Final = 'AdjustSpeedLimit'
REROUTING_SERVICE: Final = 'ReroutingService'
COLLISION_MONITOR: Final = 'CollisionMonitor'
TIME_MARKER: Final = 'TimeMarker'
OPERATIONS: Final = (ADJUST_SPEED_LIMIT, REROUTING_SERVICE, COLLISION_MONITOR, TIME_MARKER)


SCORER_NAMES: Final = (*SCORERS, DYNAMIC_EDGES)


@dataclass(frozen=True)
class RouteParameters:
    """Parameters of the route server."""

    graph_file: str = parameter('graph_filepath', '', 'GeoJSON file of the graph for routes; none when it is empty')
    edge_scorers: tuple[str, ...] = parameter(
        'edge_cost_functions',
        ('DistanceScorer', DYNAMIC_EDGES),
        'what edges of routes cost, added up: ' + ', '.join(SCORER_NAMES),
        choices=SCORER_NAMES,
    )
    operations: tuple[str, ...] = parameter(
        'operations',
        (ADJUST_SPEED_LIMIT, REROUTING_SERVICE, COLLISION_MONITOR),
        'what is done while a route is tracked: ' + ', '.join(OPERATIONS),
        choices=OPERATIONS,
    )
    trigger_events: tuple[str, ...] = parameter(
        'trigger_events',
        ('TriggerEvent',),
        'types of operations in the graph that call the service (std_srvs/Trigger) of their metadata: service_name',
    )
    shape: PathShape = field(default_factory=PathShape)
    radii: AchievedRadii = field(default_factory=AchievedRadii)
    collision_distance: float = parameter(
        'max_collision_dist', 3.0, 'how far ahead on its route the CollisionMonitor looks, m', 0.1, 1000.0
    )
    collision_rate: float = parameter('collision_check_rate', 1.0, 'how often it looks, Hz', 0.01, 50.0)
    planning_seconds: float = parameter(
        'max_planning_time', 2.0, 'how long the search for a route may take, s of wall time', 0.01, 1000.0
    )
