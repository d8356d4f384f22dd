# SPDX-License-Identifier: BSD-3-Clause
"""The flat and the processes in it: the one table that `goals` and the launch file start them from."""

from __future__ import annotations

from typing import Final

from flexbt_common import names
from flexbt_demo_behaviors.demonstration.demo_processes import Process, demo_file, mission_processes, only_robot

SPEED: Final = 0.7
"""Speed on a free and straight way, m/s: the maximum speed of the robot in the world file."""

WORLD: Final = demo_file('goals/flat.yaml')
PLACES: Final = demo_file('goals/places.yaml')


def robot_processes(speed: float) -> tuple[Process, ...]:
    """Return the simulation, with the navigation in it, and what else runs on the robot; ``speed`` in seconds per
    second."""
    return (
        only_robot(speed, WORLD, desired_linear_vel=SPEED),
        *mission_processes(PLACES, {'navigators': (names.NAVIGATE_TO_POSE,)}),
    )
