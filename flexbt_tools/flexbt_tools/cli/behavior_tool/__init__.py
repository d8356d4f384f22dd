# SPDX-License-Identifier: BSD-3-Clause
"""The executable ``behavior_tool``: one module for each command."""

from . import behavior_arguments
from .commands import COMMANDS, EXIT_CODES, main

__all__ = ['COMMANDS', 'EXIT_CODES', 'behavior_arguments', 'main']
