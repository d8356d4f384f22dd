# SPDX-License-Identifier: BSD-3-Clause
"""The flat and the processes in it: the one table that `goals` and the launch file start them from."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Final

from flexbt_common import names
from flexbt_core import load_places
from flexbt_demo_behaviors.demonstration.demo_processes import ODOM_RATE, ParameterValue, Process
from flexbt_sim.world import Pose, World

from .rooms import config_file

SPEED: Final = 0.7
"""Speed on a free and straight way, m/s: the maximum speed of the robot in the world file."""


def robot_processes(speed: float) -> tuple[Process, ...]:
    """Return the simulation, with the navigation in it, and what else runs on the robot; ``speed`` in seconds per
    second."""
    simulated: Mapping[str, ParameterValue] = {'use_sim_time': True}
    world: Mapping[str, ParameterValue] = {
        'speed_factor': speed,
        'odom_rate': ODOM_RATE,
        'world': config_file('flat.yaml'),
        'robot_namespaces': False,
        'desired_linear_vel': SPEED,
    }
    return (
        Process('flexbt_navigation', 'simulation', world),
        Process('flexbt_server', 'bt_server', {**simulated, 'navigators': (names.NAVIGATE_TO_POSE,)}),
        Process('flexbt_onboard', 'stop_guard'),
        Process('flexbt_onboard', 'onboard_executive', {**simulated, 'places': config_file('places.yaml')}),
    )


def flat() -> World:
    """Return the flat with its places, as it is at the start."""
    world = World.load(config_file('flat.yaml'))
    places = load_places(Path(config_file('places.yaml')))
    world.places = {name: Pose(place.x, place.y, place.yaw) for name, place in places.items()}
    return world
