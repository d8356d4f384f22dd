# SPDX-License-Identifier: BSD-3-Clause
"""The operator's screen: machine, trees, map, decisions and log; one key for each command. Needs textual."""

from .app import OperatorScreen
from .panes import NOTHING_SENT, NoLink, ReplayBar
from .run import run_screen, show_recording

__all__ = ['NOTHING_SENT', 'NoLink', 'OperatorScreen', 'ReplayBar', 'run_screen', 'show_recording']
