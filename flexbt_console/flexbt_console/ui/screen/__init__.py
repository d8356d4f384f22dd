# SPDX-License-Identifier: BSD-3-Clause
"""The operator's screen: machine, trees, map, decisions and log; one key for each command. Needs textual."""

from .app import OperatorScreen, run_screen, show_recording
from .replay_bar import NOTHING_SENT, NoLink, ReplayBar

__all__ = ['NOTHING_SENT', 'NoLink', 'OperatorScreen', 'ReplayBar', 'run_screen', 'show_recording']
