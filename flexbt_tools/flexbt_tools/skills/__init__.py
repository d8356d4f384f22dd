# SPDX-License-Identifier: BSD-3-Clause
"""The skills and missions of files, and how skills are told."""

from .files import read_skill_files
from .missions import mission_problems, mission_skills, read_mission_file
from .sensors import unknown_names, unreached_ports
from .skill_text import skill_lines

__all__ = [
    'mission_problems',
    'mission_skills',
    'read_mission_file',
    'read_skill_files',
    'skill_lines',
    'unknown_names',
    'unreached_ports',
]
