# SPDX-License-Identifier: BSD-3-Clause
"""The parameters of the navigation servers: declared, described and checked in one place."""

from __future__ import annotations

import json
from collections.abc import Collection
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

from rclpy.node import Node

from flexbt_common import names
from flexbt_common.errors import UnfitParameterError
from flexbt_common.liveness import PEER_TIMEOUT, PEER_TIMEOUT_TEXT
from flexbt_common.runtime import ALLOWED_DIRECTORIES_TEXT, ParameterDeclarer
from flexbt_core.values import hint, load_json, shown
from flexbt_sim.costmaps import Inflation
from flexbt_sim.errors import SimulationError
from flexbt_sim.navigation import FollowerLimits
from flexbt_sim.world import Circle, Polygon, RobotModel, WorldFile

from .docking_parameters import DockingParameters, declare_docking_parameters
from .route_parameters import RouteParameters, declare_route_parameters

MOST_SPEED: Final = 10.0
"""Of a robot, m/s."""

MOST_RADIUS: Final = 50.0
"""Of a robot, m; as a world file may have it."""


@dataclass
class NavigationParameters:
    """Values of the parameters; see :func:`declare_navigation_parameters` for meaning and unit.

    While the servers run, ``follower`` and ``planner_tolerance`` may be set to others, for the goals and paths that
    come then. On the executor thread.
    """

    owner_nodes: tuple[str, ...]
    robot_nodes: tuple[str, ...]
    peer_timeout: float
    planner_ids: tuple[str, ...]
    controller_ids: tuple[str, ...]
    goal_checker_ids: tuple[str, ...]
    progress_checker_ids: tuple[str, ...]
    planner_tolerance: float
    inflation: Inflation
    follower: FollowerLimits
    map_frame: str
    transform_tolerance: float
    pose_topic: str
    map_topic: str
    filter_info_topic: str
    scan_topic: str
    base_frame: str
    cmd_vel_topic: str
    stamped_cmd_vel: bool
    pose_timeout: float
    collision_monitor: bool
    time_before_collision: float
    routes: RouteParameters
    docking: DockingParameters
    allowed_directories: tuple[Path, ...]


def declare_navigation_parameters(node: Node) -> NavigationParameters:
    """Declare the parameters on ``node`` and read them.

    Raises:
        UnfitParameterError: a value that cannot work.
    """
    declare = ParameterDeclarer(node)
    inflation, follower = _of_robot(
        declare.text('world', '', 'world file; its robot is known by its footprint, turning radius and speed'),
        declare.text('robot', '', 'its name there; empty for the last name of the namespace, or the only robot'),
        node.get_namespace().rpartition('/')[2],
    )
    follower = replace(
        follower,
        speed=declare.real(
            'desired_linear_vel', follower.speed, 0.01, MOST_SPEED, 'speed on a free and straight way, m/s'
        ),
        proximity_distance=declare.real(
            'cost_scaling_dist',
            follower.proximity_distance,
            0.01,
            10.0,
            'nearer to an obstacle than this the robot drives slower, in proportion, m',
        ),
        xy_tolerance=declare.real('xy_goal_tolerance', follower.xy_tolerance, 0.01, 2.0, 'm'),
        turning_radius=declare.real(
            'minimum_turning_radius',
            follower.turning_radius,
            0.0,
            100.0,
            'least radius of a bend of a car-like robot, m; 0 for one that turns on the spot',
        ),
        reverses=declare.flag(
            'allow_reversing', True, 'whether a car-like robot is driven backward where its path leads there'
        ),
        yaw_tolerance=declare.real('yaw_goal_tolerance', follower.yaw_tolerance, 0.01, 3.2, 'rad'),
        progress_distance=declare.real('required_movement_radius', follower.progress_distance, 0.01, 10.0, 'm'),
        progress_time=declare.real('movement_time_allowance', follower.progress_time, 0.1, 1000.0, 's'),
        patience=declare.real(
            'failure_tolerance', follower.patience, 0.0, 60.0, 'how long an obstacle is waited for, s'
        ),
    )
    routes = declare_route_parameters(declare)
    docking = declare_docking_parameters(declare, follower.turning_radius)
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
        planner_ids=declare.texts('planner_ids', ['GridBased'], 'names under which the planner is known'),
        controller_ids=declare.texts('controller_ids', ['FollowPath'], 'names under which the controller is known'),
        goal_checker_ids=declare.texts(
            'goal_checker_ids', ['general_goal_checker', 'goal_checker'], 'names under which the goal checker is known'
        ),
        progress_checker_ids=declare.texts(
            'progress_checker_ids', ['progress_checker'], 'names under which the progress checker is known'
        ),
        planner_tolerance=declare.real(
            'tolerance',
            0.0,
            0.0,
            10.0,
            'how far from a goal that cannot be reached a path may end, m; 0: nowhere else',
        ),
        inflation=_inflation(
            declare.text(
                'footprint', _written(inflation.corners), 'corners of a robot that is no circle, m: [[x, y], ...]'
            ),
            declare.real('robot_radius', inflation.robot_radius, 0.001, MOST_RADIUS, 'radius of the robot, m'),
            declare.real('inflation_radius', inflation.radius, 0.0, 10.0, 'how far costs reach round obstacles, m'),
            declare.real('cost_scaling_factor', inflation.scaling, 0.1, 100.0, 'how fast costs fall off, 1/m'),
        ),
        follower=follower,
        map_frame=declare.text('global_frame', 'map', 'frame of map, poses and paths'),
        transform_tolerance=declare.real(
            'transform_tolerance', 0.3, 0.0, 10.0, 'how long the transform of a request is waited for, s of wall time'
        ),
        pose_topic=declare.text('pose_topic', names.POSE, "topic of the robot's pose, geometry_msgs/PoseStamped"),
        map_topic=declare.text('map_topic', names.MAP, 'topic of the map'),
        filter_info_topic=declare.text(
            'filter_info_topic',
            names.KEEPOUT_FILTER_INFO,
            'topic that names the mask of areas to keep out of, nav2_msgs/CostmapFilterInfo',
        ),
        scan_topic=declare.text('scan_topic', names.SCAN, 'topic of the lidar, sensor_msgs/LaserScan'),
        base_frame=declare.text('robot_base_frame', 'base_link', 'frame of the robot, in which the lidar is mounted'),
        cmd_vel_topic=declare.text('cmd_vel_topic', names.CMD_VEL, 'topic of the velocity commands'),
        stamped_cmd_vel=declare.flag('enable_stamped_cmd_vel', False, 'commands are TwistStamped instead of Twist'),
        pose_timeout=declare.real(
            'pose_timeout',
            1.0,
            0.1,
            60.0,
            'time without a pose after which motions fail, s; a pause of simulated time does not count',
        ),
        collision_monitor=declare.flag(
            'collision_monitor', False, 'whether commands are slowed down before collisions, as the service toggles it'
        ),
        time_before_collision=declare.real(
            'time_before_collision', 1.2, 0.1, 10.0, 'how far ahead the collision monitor looks, s'
        ),
        routes=routes,
        docking=docking,
        allowed_directories=(
            *declare.directories('allowed_directories', (), ALLOWED_DIRECTORIES_TEXT),
            *(Path(file).absolute().parent for file in (routes.graph_file, docking.database) if file),
        ),
    )


def _of_robot(world: str, name: str, namespace: str) -> tuple[Inflation, FollowerLimits]:
    """The defaults for the robot of the parameters ``world`` and ``robot``. Raises UnfitParameterError."""
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
        raise UnfitParameterError('robot', f'{world} has no robot {wanted!r}{hint(wanted, robots)}; there are: {there}')
    model = robots[wanted]
    try:
        follower = FollowerLimits.of(model.drive)
        return Inflation.of(model.footprint), replace(follower, speed=min(follower.speed, MOST_SPEED))
    except SimulationError as error:
        raise UnfitParameterError('world', f'robot {wanted!r}: {error}') from None


def _written(corners: Collection[tuple[float, float]]) -> str:
    return json.dumps([[x, y] for x, y in corners]) if corners else ''


def _inflation(corners: str, radius: float, *fall: float) -> Inflation:
    """For the footprint of the parameters ``footprint`` and ``robot_radius``. Raises UnfitParameterError."""
    try:
        polygon = tuple((float(x), float(y)) for x, y in load_json(corners)) if corners else ()
        return Inflation.of(Polygon(polygon) if polygon else Circle(radius), *fall)
    except (ValueError, TypeError, OverflowError, RecursionError, SimulationError) as error:
        raise UnfitParameterError('footprint', f'{shown(corners)}: {error}; give [[x, y], ...] in m') from None
