# SPDX-License-Identifier: BSD-3-Clause
"""The warehouse and the processes in it: the one table that `nav2_robot` and the launch file start them from."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

from flexbt_common import names
from flexbt_demo_behaviors.demonstration.demo_processes import (
    ParameterValue,
    Process,
    demo_file,
    mission_processes,
    only_robot,
)

FOLDER: Final = 'flexbt_demo_behaviors/nav2_robot'

PROGRAM: Final = Process('flexbt_demo_behaviors', 'deliveries')
"""The program that drives the robot."""

WORLD: Final = demo_file('nav2_robot/warehouse.yaml')
PLACES: Final = demo_file('nav2_robot/places.yaml')


def robot_processes(speed: float) -> tuple[Process, ...]:
    """Return the simulation, with the navigation in it, and what else runs on the robot, but for the program; ``speed``
    in seconds per second.
    """
    navigators: Mapping[str, ParameterValue] = {
        'navigators': (names.NAVIGATE_TO_POSE, names.NAVIGATE_THROUGH_POSES, names.FOLLOW_WAYPOINTS),
        'default_nav_to_pose_bt_xml': f'{FOLDER}/navigate_to_pose.xml',
        'default_nav_through_poses_bt_xml': f'{FOLDER}/navigate_through_poses.xml',
    }
    return only_robot(speed, WORLD), *mission_processes(PLACES, navigators)
