# SPDX-License-Identifier: BSD-3-Clause
"""The executable ``nav2_robot``: the processes of the robot, its program, the scripted operator, and the picture."""

from .robot_processes import PROGRAM, config_file, robot_processes, warehouse
from .script import BRANCHES, TITLE, Warehouse, supervise

__all__ = [
    'BRANCHES',
    'PROGRAM',
    'TITLE',
    'Warehouse',
    'config_file',
    'robot_processes',
    'supervise',
    'warehouse',
]
