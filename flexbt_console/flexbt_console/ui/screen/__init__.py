# SPDX-License-Identifier: BSD-3-Clause
"""The operator's screen: machine, trees, map, decisions and log; one key for each command. Needs textual."""

from .app import OperatorScreen, run_screen
from .keys import KEYS

__all__ = ['KEYS', 'OperatorScreen', 'run_screen']
