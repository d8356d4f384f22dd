# SPDX-License-Identifier: BSD-3-Clause
"""The executable ``bt_tool``: one module for each command. Needs no ROS."""

from .commands import COMMANDS, EXIT_CODES, main

__all__ = ['COMMANDS', 'EXIT_CODES', 'main']
