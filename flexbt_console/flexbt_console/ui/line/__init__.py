# SPDX-License-Identifier: BSD-3-Clause
"""The line mode: one command, its answer, an exit code."""

from .line_mode import Session, run
from .robots import found_robots, list_robots

__all__ = ['Session', 'found_robots', 'list_robots', 'run']
