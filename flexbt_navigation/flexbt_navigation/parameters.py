# SPDX-License-Identifier: BSD-3-Clause
"""The parameters of the node ``navigation``: those of its servers, which each of them declares, and its own."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

from rclpy.node import Node

from flexbt_common import names
from flexbt_common.errors import UnfitParameterError
from flexbt_common.lifecycle.liveliness import PEER_TIMEOUT, PEER_TIMEOUT_TEXT
from flexbt_common.runtime.parameters import ParameterDeclarer
from flexbt_core.values.text import did_you_mean
from flexbt_navigation.common.parameters import RobotParameters, declare_robot_parameters
from flexbt_navigation.controller.path_follower import FollowerLimits
from flexbt_navigation.controller.server import MOST_ROBOT_SPEED, ControllerParameters, declare_controller_parameters
from flexbt_navigation.costmaps.costmap import Inflation
from flexbt_navigation.costmaps.parameters import CostmapParameters, declare_costmap_parameters
from flexbt_navigation.docking.server import DockingParameters, declare_docking_parameters
from flexbt_navigation.planner.server import PlannerParameters, declare_planner_parameters
from flexbt_navigation.routes.parameters import RouteParameters, declare_route_parameters
from flexbt_sim.errors import SimulationError
from flexbt_sim.world.descriptions.models import RobotModel
from flexbt_sim.world.descriptions.world_file import WorldFile

from .collision_monitor import CollisionMonitorParameters, declare_collision_monitor_parameters


@dataclass(frozen=True)
class NavigationParameters:
    """Values of the parameters; see :func:`declare_navigation_parameters` for meaning and unit."""

    owner_nodes: tuple[str, ...]
    robot_nodes: tuple[str, ...]
    peer_timeout: float
    robot: RobotParameters
    costmaps: CostmapParameters
    planner: PlannerParameters
    controller: ControllerParameters
    collision_monitor: CollisionMonitorParameters
    routes: RouteParameters
    docking: DockingParameters


def declare_navigation_parameters(node: Node) -> NavigationParameters:
    """Declare the parameters on ``node`` and read them.

    Raises:
        UnfitParameterError: a value that cannot work.
    """
    declare = ParameterDeclarer(node)
    inflation, limits = _of_robot(
        declare.text('world', '', 'world file; its robot is known by its footprint, turning radius and speed'),
        declare.text('robot', '', 'its name there; empty for the last name of the namespace, or the only robot'),
        node.get_namespace().rpartition('/')[2],
    )
    controller = declare_controller_parameters(declare, limits)
    routes = declare_route_parameters(declare)
    docking = declare_docking_parameters(declare, controller.follower.turning_radius)
    return NavigationParameters(
        owner_nodes=declare.texts(
            'owner_nodes',
            [names.BT_SERVER],
            'nodes that give the goals: while one is late the robot is held, and when one is gone every goal is ended; '
            '[""] for none',
        ),
        robot_nodes=declare.texts(
            'robot_nodes', [names.SIMULATOR], 'nodes without which there is no robot: when one is gone every goal fails'
        ),
        peer_timeout=declare.real('peer_timeout', PEER_TIMEOUT, 0.6, 3600.0, PEER_TIMEOUT_TEXT),
        robot=declare_robot_parameters(declare, (routes.graph_file, docking.database)),
        costmaps=declare_costmap_parameters(declare, inflation),
        planner=declare_planner_parameters(declare),
        controller=controller,
        collision_monitor=declare_collision_monitor_parameters(declare),
        routes=routes,
        docking=docking,
    )


def _of_robot(world: str, name: str, namespace: str) -> tuple[Inflation, FollowerLimits]:
    """Return the defaults for the robot of the parameters ``world`` and ``robot``. Raises UnfitParameterError."""
    if not world:
        if name:
            raise UnfitParameterError('robot', f"{name}: there is no parameter 'world', whose robot it could be")
        return Inflation(), FollowerLimits()
    try:
        models = {entity: model for _, entity, model, _ in WorldFile(Path(world)).entities}
    except SimulationError as error:
        raise UnfitParameterError('world', str(error)) from None
    robots = {entity: model for entity, model in models.items() if isinstance(model, RobotModel)}
    wanted = name or (namespace if namespace in robots or len(robots) != 1 else next(iter(robots)))
    if wanted not in robots:
        there = ', '.join(robots) or 'none'
        raise UnfitParameterError(
            'robot', f'{world} has no robot {wanted!r}{did_you_mean(wanted, robots)}; there are: {there}'
        )
    model = robots[wanted]
    try:
        follower = FollowerLimits.of(model.drive)
        return Inflation.of(model.footprint), replace(follower, speed=min(follower.speed, MOST_ROBOT_SPEED))
    except SimulationError as error:
        raise UnfitParameterError('world', f'robot {wanted!r}: {error}') from None
