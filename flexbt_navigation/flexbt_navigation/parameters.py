# SPDX-License-Identifier: BSD-3-Clause
"""The parameters of the node ``navigation``: its own, and those of its servers, which each server declares."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from pathlib import Path

from rclpy.node import Node

from flexbt_common import names
from flexbt_common.errors import UnfitParameterError
from flexbt_common.lifecycle.liveliness import PEER_TIMEOUT, PEER_TIMEOUT_TEXT
from flexbt_common.runtime.parameters import ALLOWED_DIRECTORIES_TEXT, ParameterDeclarer
from flexbt_core.values.parameter_fields import parameter
from flexbt_core.values.text import did_you_mean
from flexbt_navigation.common.requests import RobotParameters
from flexbt_navigation.controller.path_follower import MOST_ROBOT_SPEED, FollowerLimits
from flexbt_navigation.controller.server import ControllerParameters
from flexbt_navigation.costmaps.costmap import Inflation
from flexbt_navigation.costmaps.layers import KNOWN_TOLERANCE, known_tolerance
from flexbt_navigation.costmaps.server import CostmapParameters, declare_inflation
from flexbt_navigation.docking.server import DockingParameters, declare_docking_parameters
from flexbt_navigation.planner.server import PlannerParameters
from flexbt_navigation.routes.server import RouteParameters
from flexbt_sim.errors import SimulationError
from flexbt_sim.world.models import RobotModel
from flexbt_sim.world.world_file import WorldFile

from .collision_monitor import CollisionMonitorParameters


@dataclass(frozen=True)
class NavigationParameters:
    """Parameters of the node."""

    robot: RobotParameters
    costmaps: CostmapParameters
    controller: ControllerParameters
    routes: RouteParameters
    docking: DockingParameters
    planner: PlannerParameters = field(default_factory=PlannerParameters)
    collision_monitor: CollisionMonitorParameters = field(default_factory=CollisionMonitorParameters)
    owner_nodes: tuple[str, ...] = parameter(
        'owner_nodes',
        (names.BT_SERVER,),
        'nodes that send goals: while one is late the robot is held, and when one is gone all goals end; [""] for none',
    )
    robot_nodes: tuple[str, ...] = parameter(
        'robot_nodes', (names.SIMULATOR,), 'nodes of the robot: when one is gone all goals fail'
    )
    peer_timeout: float = parameter('peer_timeout', PEER_TIMEOUT, PEER_TIMEOUT_TEXT, 0.6, 3600.0)


def declare_navigation_parameters(node: Node) -> NavigationParameters:
    """Declare the parameters on ``node`` and read them.

    Raises:
        UnfitParameterError: a value is not usable.
    """
    declare = ParameterDeclarer(node)
    inflation, limits, tolerance = _of_robot(
        declare.text('world', '', 'world file; its robot is known by its footprint, turning radius and speed'),
        declare.text('robot', '', 'its name there; empty for the last name of the namespace, or the only robot'),
        node.get_namespace().rpartition('/')[2],
    )
    controller = declare.fields(ControllerParameters(follower=limits))
    routes = declare.fields(RouteParameters())
    docking = declare_docking_parameters(declare, controller.follower)
    allowed = (
        *declare.directories('allowed_directories', (), ALLOWED_DIRECTORIES_TEXT),
        *(Path(file).absolute().parent for file in (routes.graph_file, docking.database) if file),
    )
    return declare.fields(
        NavigationParameters(
            robot=RobotParameters(allowed_directories=allowed),
            costmaps=CostmapParameters(declare_inflation(declare, inflation), tolerance=tolerance),
            controller=controller,
            routes=routes,
            docking=docking,
        )
    )


def _of_robot(world: str, name: str, namespace: str) -> tuple[Inflation, FollowerLimits, float]:
    """Return the defaults for the robot of the parameters ``world`` and ``robot``, and the tolerance for its lidar.
    Raises UnfitParameterError."""
    if not world:
        if name:
            raise UnfitParameterError('robot', f"{name}: there is no parameter 'world', whose robot it could be")
        return Inflation(), FollowerLimits(), KNOWN_TOLERANCE
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
        limits = replace(follower, speed=min(follower.speed, MOST_ROBOT_SPEED))
        return Inflation.of(model.footprint), limits, known_tolerance(model.lidar)
    except SimulationError as error:
        raise UnfitParameterError('world', f'robot {wanted!r}: {error}') from None
