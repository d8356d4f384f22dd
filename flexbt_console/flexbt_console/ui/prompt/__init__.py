# SPDX-License-Identifier: BSD-3-Clause
"""The interactive prompt: a line to type on, the present state below it, events above it. Needs prompt_toolkit."""

from .session import Prompt, run_prompt
from .toolbar import toolbar

__all__ = ['Prompt', 'run_prompt', 'toolbar']
