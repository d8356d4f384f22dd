# SPDX-License-Identifier: BSD-3-Clause
"""What the prompt and the screen share: what a typed line means, the decision that it answers, how they end, and what
others write to the terminal."""

from collections.abc import Callable
from contextlib import AbstractContextManager

from .attention import Attention
from .sent_commands import SentCommands
from .short_form import CHANGED, Bound, Local, Meaning, NoLiveLinkError, choose, interpret
from .shown_decision import REACTION_SECONDS, ShownDecision
from .standard_error import standard_error_as_lines

__all__ = [
    'CHANGED',
    'REACTION_SECONDS',
    'Attention',
    'Bound',
    'Local',
    'Meaning',
    'NoLiveLinkError',
    'OnSignal',
    'SentCommands',
    'ShownDecision',
    'choose',
    'interpret',
    'standard_error_as_lines',
]

OnSignal = Callable[[Callable[[], object]], AbstractContextManager[None]]
"""See :meth:`flexbt_console.ui.terminal_watch.TerminalWatch.on_signal`."""
