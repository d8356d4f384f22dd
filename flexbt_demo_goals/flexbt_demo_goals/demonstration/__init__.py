# SPDX-License-Identifier: BSD-3-Clause
"""The executable ``goals``: the processes of the robot, the scripted operator, what others do, and the picture."""

from .robot_processes import flat, robot_processes
from .script import BRANCHES, TITLE, Flat, reach_goals

__all__ = ['BRANCHES', 'TITLE', 'Flat', 'flat', 'reach_goals', 'robot_processes']
