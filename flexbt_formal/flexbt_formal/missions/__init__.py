# SPDX-License-Identifier: BSD-3-Clause
"""Missions: their files, and the check of trees that name one. The leaf that reaches the goal of one needs ROS: see
:mod:`flexbt_formal.missions.reach_goal`, which bt_server finds by an entry point.
"""

from .mission_check import missions
from .mission_files import mission_problems, mission_skills, read_mission_file

__all__ = ['mission_problems', 'mission_skills', 'missions', 'read_mission_file']
