# SPDX-License-Identifier: BSD-3-Clause
"""Synthesis with the states that are installed, its files, and its answers as text."""

from .answer_text import explanation_lines, happening, step_through
from .files import SynthesisFiles, read, read_problem
from .flexbe_messages import flexbe_messages
from .state_interfaces import StateInterfaces

__all__ = [
    'StateInterfaces',
    'SynthesisFiles',
    'explanation_lines',
    'flexbe_messages',
    'happening',
    'read',
    'read_problem',
    'step_through',
]
