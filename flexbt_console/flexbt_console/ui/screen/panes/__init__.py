# SPDX-License-Identifier: BSD-3-Clause
"""What is on the screen: the panes with their texts, the line that is typed, and which of them have room."""

from .decision_bar import BURST_SECONDS, ROWS, Burst, Picking, choice_texts, waiting_texts
from .layout import PANES, Layout
from .machine_pane import outcome_texts
from .map_pane import CURSOR_STEPS, CURSOR_TURNS
from .pane import TONES, Pane, styled
from .panes import Panes, Shown
from .replay_bar import MOVES, NOTHING_SENT, NoLink, Player, ReplayBar, replay_help_lines
from .status_lines import others_text
from .typed_line import TypedLine

__all__ = [
    'BURST_SECONDS',
    'CURSOR_STEPS',
    'CURSOR_TURNS',
    'MOVES',
    'NOTHING_SENT',
    'PANES',
    'ROWS',
    'TONES',
    'Burst',
    'Layout',
    'NoLink',
    'Pane',
    'Panes',
    'Picking',
    'Player',
    'ReplayBar',
    'Shown',
    'TypedLine',
    'choice_texts',
    'others_text',
    'outcome_texts',
    'replay_help_lines',
    'styled',
    'waiting_texts',
]
