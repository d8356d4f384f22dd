# SPDX-License-Identifier: BSD-3-Clause
"""The executable ``behavior_tool``: one module for each command."""

from .commands import COMMANDS, EXIT_CODES, main

__all__ = ['COMMANDS', 'EXIT_CODES', 'main']
