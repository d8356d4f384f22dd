# SPDX-License-Identifier: BSD-3-Clause
"""The skills of files, and how skills are told."""

from .files import read_skill_files
from .sensors import unknown_names, unreached_ports
from .skill_text import skill_lines

__all__ = [
    'read_skill_files',
    'skill_lines',
    'unknown_names',
    'unreached_ports',
]
