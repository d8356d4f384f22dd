# SPDX-License-Identifier: BSD-3-Clause
"""The skills of what is installed and of files, and how they are told."""

from .files import read_skill_files
from .installed import node_skills
from .sensors import unknown_names
from .skill_text import skill_lines

__all__ = ['node_skills', 'read_skill_files', 'skill_lines', 'unknown_names']
