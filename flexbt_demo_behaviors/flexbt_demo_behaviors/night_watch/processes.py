# SPDX-License-Identifier: BSD-3-Clause
"""The building and the processes of the night watch: the one table that `night_watch` and the launch file start
them from.
"""

from __future__ import annotations

from pathlib import Path
from typing import Final

from ament_index_python.packages import get_package_share_directory

from flexbt_core import load_places
from flexbt_demo_behaviors.demonstration.demo_processes import ODOM_RATE, Process
from flexbt_demo_behaviors.demonstration.robot_track import TrackPose
from flexbt_sim.world import Pose as WorldPose
from flexbt_sim.world import World

ROBOTS: Final = ('alpha', 'beta')

SPEED: Final = 0.7
"""Speed on a free and straight way, m/s: the maximum speed of the robots in the world file."""


def config_file(name: str) -> str:
    """Return the path of a file of this demonstration."""
    return str(Path(get_package_share_directory('flexbt_demo_behaviors')) / 'night_watch' / name)


def watch_processes(speed: float) -> tuple[Process, ...]:
    """Return the simulator, and navigation, BT server, stop guard and executive of each robot; ``speed`` in seconds per
    second."""
    building = config_file('building.yaml')
    world = Process('flexbt_sim', 'simulator', {'speed_factor': speed, 'world': building, 'odom_rate': ODOM_RATE})
    return (world, *(process for robot in ROBOTS for process in robot_processes(robot)))


def robot_processes(robot: str) -> tuple[Process, ...]:
    """Return what runs on one robot."""
    places = config_file('places.yaml')
    return (
        Process('flexbt_navigation', 'navigation', {'use_sim_time': True, 'desired_linear_vel': SPEED}, robot),
        Process('flexbt_server', 'bt_server', {'use_sim_time': True}, robot),
        Process('flexbt_onboard', 'stop_guard', namespace=robot),
        Process('flexbt_onboard', 'onboard_executive', {'use_sim_time': True, 'places': places}, robot),
    )


def log_name(process: Process) -> str:
    """Under which name a process is started, and its log file is written."""
    return f'{process.namespace}_{process.name}' if process.namespace else process.name


def place_poses() -> dict[str, TrackPose]:
    """Return the named places of the building."""
    return {
        name: TrackPose(place.x, place.y, place.yaw)
        for name, place in load_places(Path(config_file('places.yaml'))).items()
    }


def watch_world() -> World:
    """Return the building with its places, as it is in the evening."""
    world = World.load(config_file('building.yaml'))
    world.places = {name: WorldPose(place.x, place.y, place.yaw) for name, place in place_poses().items()}
    return world
