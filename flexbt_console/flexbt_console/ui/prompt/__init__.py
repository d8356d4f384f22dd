# SPDX-License-Identifier: BSD-3-Clause
"""The interactive prompt: a line to type on, the present state below it, events above it. Needs prompt_toolkit."""

from .cells import cut, cut_middle, fold
from .session import LEAVING, Prompt, run_prompt
from .short_form import Bound, Local, Meaning, interpret
from .shown_decision import REACTION_SECONDS, ShownDecision
from .toolbar import toolbar

__all__ = [
    'LEAVING',
    'REACTION_SECONDS',
    'Bound',
    'Local',
    'Meaning',
    'Prompt',
    'ShownDecision',
    'cut',
    'cut_middle',
    'fold',
    'interpret',
    'run_prompt',
    'toolbar',
]
