# SPDX-License-Identifier: BSD-3-Clause
"""What the prompt and the screen share: what a typed line means, the decision that it answers, cells of a terminal."""

from .attention import Attention
from .cells import cut, cut_middle, fold, width
from .short_form import Bound, Local, Meaning, NoLiveLinkError, choose, interpret
from .shown_decision import REACTION_SECONDS, ShownDecision

__all__ = [
    'REACTION_SECONDS',
    'Attention',
    'Bound',
    'Local',
    'Meaning',
    'NoLiveLinkError',
    'ShownDecision',
    'choose',
    'cut',
    'cut_middle',
    'fold',
    'interpret',
    'width',
]
