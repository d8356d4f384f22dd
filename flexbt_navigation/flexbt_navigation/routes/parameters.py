# SPDX-License-Identifier: BSD-3-Clause
"""The parameters of the route server, with Nav2's names."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from flexbt_common.errors import UnfitParameterError
from flexbt_common.runtime.parameters import ParameterDeclarer

from .edge_scorers import SCORERS
from .route import PathShape
from .tracker import AchievedRadii

DYNAMIC_EDGES: Final = 'DynamicEdgesScorer'
ADJUST_SPEED_LIMIT: Final = 'AdjustSpeedLimit'
REROUTING_SERVICE: Final = 'ReroutingService'
COLLISION_MONITOR: Final = 'CollisionMonitor'
TIME_MARKER: Final = 'TimeMarker'
OPERATIONS: Final = (ADJUST_SPEED_LIMIT, REROUTING_SERVICE, COLLISION_MONITOR, TIME_MARKER)


@dataclass(frozen=True)
class RouteParameters:
    """Values of the parameters; see :func:`declare_route_parameters` for meaning and unit."""

    graph_file: str
    edge_scorers: tuple[str, ...]
    operations: tuple[str, ...]
    trigger_events: tuple[str, ...]
    shape: PathShape
    radii: AchievedRadii
    collision_distance: float
    collision_rate: float
    planning_seconds: float


def declare_route_parameters(declare: ParameterDeclarer) -> RouteParameters:
    """Declare the parameters and read them.

    Raises:
        UnfitParameterError: a value that cannot work.
    """
    density = declare.real('path_density', 0.05, 0.01, 10.0, "greatest distance of the poses of a route's path, m")
    radius = declare.real('smoothing_radius', 1.0, 0.01, 100.0, "radius of the corners of a route's path, m")
    rounded = declare.flag('smooth_corners', True, "whether the corners of a route's path are rounded")
    return RouteParameters(
        graph_file=declare.text('graph_filepath', '', 'GeoJSON file of the graph for routes; none when it is empty'),
        edge_scorers=_known(
            'edge_cost_functions',
            declare.texts(
                'edge_cost_functions',
                ['DistanceScorer', DYNAMIC_EDGES],
                'what edges of routes cost, added up: ' + ', '.join((*SCORERS, DYNAMIC_EDGES)),
            ),
            (*SCORERS, DYNAMIC_EDGES),
        ),
        operations=_known(
            'operations',
            declare.texts(
                'operations',
                [ADJUST_SPEED_LIMIT, REROUTING_SERVICE, COLLISION_MONITOR],
                'what is done while a route is tracked: ' + ', '.join(OPERATIONS),
            ),
            OPERATIONS,
        ),
        trigger_events=declare.texts(
            'trigger_events',
            ['TriggerEvent'],
            'types of operations in the graph that call the service (std_srvs/Trigger) of their metadata: service_name',
        ),
        shape=PathShape(density, radius if rounded else 0.0),
        radii=AchievedRadii(
            node=declare.real('radius_to_achieve_node', 2.0, 0.01, 100.0, 'how near to a node it may be achieved, m'),
            boundary=declare.real(
                'boundary_radius_to_achieve_node', 1.0, 0.01, 100.0, 'the same for the first and the last node, m'
            ),
        ),
        collision_distance=declare.real(
            'max_collision_dist', 3.0, 0.1, 1000.0, 'how far ahead on its route the CollisionMonitor looks, m'
        ),
        collision_rate=declare.real('collision_check_rate', 1.0, 0.01, 50.0, 'how often it looks, Hz'),
        planning_seconds=declare.real(
            'max_planning_time', 2.0, 0.01, 1000.0, 'how long the search for a route may take, s of wall time'
        ),
    )


def _known(name: str, given: tuple[str, ...], known: tuple[str, ...]) -> tuple[str, ...]:
    for text in given:
        if text not in known:
            raise UnfitParameterError(name, f'there is no {text!r}; known: {", ".join(known)}')
    return given
