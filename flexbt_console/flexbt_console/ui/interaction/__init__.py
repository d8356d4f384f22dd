# SPDX-License-Identifier: BSD-3-Clause
"""What the prompt and the screen share: what a typed line means, the decision that it answers, and how they end."""

from .attention import Attention
from .ending import EndingLoop
from .short_form import CHANGED, Bound, Local, Meaning, NoLiveLinkError, choose, interpret
from .shown_decision import REACTION_SECONDS, ShownDecision

__all__ = [
    'CHANGED',
    'REACTION_SECONDS',
    'Attention',
    'Bound',
    'EndingLoop',
    'Local',
    'Meaning',
    'NoLiveLinkError',
    'ShownDecision',
    'choose',
    'interpret',
]
