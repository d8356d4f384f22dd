# SPDX-License-Identifier: BSD-3-Clause
"""What prompt, screen and page share: what a key or a line means, which decision it answers, how they end, and what
others write to the terminal."""

from collections.abc import Callable
from contextlib import AbstractContextManager

from .attention import Attention
from .carrying_out import Later, Reading, Station, carry_out
from .keys import HOW_KEYS_SEND, KEYS, Key, has_map, help_lines
from .restarts import Restarts
from .sent_commands import SentCommands
from .short_form import CHANGED, Bound, Local, Meaning, NoLiveLinkError, choose, interpret
from .shown_decision import REACTION_SECONDS, ShownDecision
from .standard_error import standard_error_as_lines

__all__ = [
    'CHANGED',
    'HOW_KEYS_SEND',
    'KEYS',
    'REACTION_SECONDS',
    'Attention',
    'Bound',
    'Key',
    'Later',
    'Local',
    'Meaning',
    'NoLiveLinkError',
    'OnSignal',
    'Reading',
    'Restarts',
    'SentCommands',
    'ShownDecision',
    'Station',
    'carry_out',
    'choose',
    'has_map',
    'help_lines',
    'interpret',
    'standard_error_as_lines',
]

OnSignal = Callable[[Callable[[], object]], AbstractContextManager[None]]
"""See :meth:`flexbt_console.ui.terminal_watch.TerminalWatch.on_signal`."""
