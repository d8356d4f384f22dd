# SPDX-License-Identifier: BSD-3-Clause
"""The building and the processes of the night watch: the one table that `night_watch` and the launch file start
them from.
"""

from __future__ import annotations

from typing import Final

from flexbt_demo_behaviors.demonstration.demo_processes import (
    ODOM_RATE,
    SIMULATED,
    Process,
    demo_file,
    mission_processes,
)

ROBOTS: Final = ('alpha', 'beta')

SPEED: Final = 0.7
"""Speed on a free and straight way, m/s: the maximum speed of the robots in the world file."""


WORLD: Final = demo_file('night_watch/building.yaml')
PLACES: Final = demo_file('night_watch/places.yaml')


def watch_processes(speed: float) -> tuple[Process, ...]:
    """Return the simulator, and navigation, BT server, stop guard and executive of each robot; ``speed`` in seconds per
    second."""
    world = Process('flexbt_sim', 'simulator', {'speed_factor': speed, 'world': WORLD, 'odom_rate': ODOM_RATE})
    return (world, *(process for robot in ROBOTS for process in robot_processes(robot)))


def robot_processes(robot: str) -> tuple[Process, ...]:
    """Return what runs on one robot."""
    return (
        Process('flexbt_navigation', 'navigation', {**SIMULATED, 'desired_linear_vel': SPEED}, robot),
        *mission_processes(PLACES, namespace=robot),
    )


def log_name(process: Process) -> str:
    """Under which name a process is started, and its log file is written."""
    return f'{process.namespace}_{process.name}' if process.namespace else process.name
