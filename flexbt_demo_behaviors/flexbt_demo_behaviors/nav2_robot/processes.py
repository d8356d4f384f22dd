# SPDX-License-Identifier: BSD-3-Clause
"""The warehouse and the processes in it: the one table that `nav2_robot` and the launch file start them from."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Final

from ament_index_python.packages import get_package_share_directory

from flexbt_common import names
from flexbt_core import load_places
from flexbt_demo_behaviors.demonstration.demo_processes import ODOM_RATE, ParameterValue, Process
from flexbt_sim.world import Pose, World

PACKAGE: Final = 'flexbt_demo_behaviors'

PROGRAM: Final = Process(PACKAGE, 'deliveries')
"""The program that drives the robot."""


def config_file(name: str) -> str:
    """Return the path of a file of this demonstration."""
    return str(Path(get_package_share_directory(PACKAGE)) / 'nav2_robot' / name)


def robot_processes(speed: float) -> tuple[Process, ...]:
    """Return the simulation, with the navigation in it, and what else runs on the robot, but for the program; ``speed``
    in seconds per second.
    """
    simulated: Mapping[str, ParameterValue] = {'use_sim_time': True}
    navigators: Mapping[str, ParameterValue] = {
        'navigators': (names.NAVIGATE_TO_POSE, names.NAVIGATE_THROUGH_POSES, names.FOLLOW_WAYPOINTS),
        'default_nav_to_pose_bt_xml': f'{PACKAGE}/nav2_robot/navigate_to_pose.xml',
        'default_nav_through_poses_bt_xml': f'{PACKAGE}/nav2_robot/navigate_through_poses.xml',
    }
    world: Mapping[str, ParameterValue] = {
        'speed_factor': speed,
        'odom_rate': ODOM_RATE,
        'world': config_file('warehouse.yaml'),
        'robot_namespaces': False,
    }
    return (
        Process('flexbt_navigation', 'simulation', world),
        Process('flexbt_server', 'bt_server', {**simulated, **navigators}),
        Process('flexbt_onboard', 'stop_guard'),
        Process('flexbt_onboard', 'onboard_executive', {**simulated, 'places': config_file('places.yaml')}),
    )


def warehouse() -> World:
    """Return the warehouse with its places, as it is at the start."""
    world = World.load(config_file('warehouse.yaml'))
    places = load_places(Path(config_file('places.yaml')))
    world.places = {name: Pose(place.x, place.y, place.yaw) for name, place in places.items()}
    return world
