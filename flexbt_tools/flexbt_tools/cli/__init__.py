# SPDX-License-Identifier: BSD-3-Clause
"""What the executables bt_tool and behavior_tool share; each has a room of its own here."""

from . import arguments, picture_output, report, skill_output
from .command import Command, run_command
from .report import Reported

__all__ = [
    'Command',
    'Reported',
    'arguments',
    'picture_output',
    'report',
    'run_command',
    'skill_output',
]
