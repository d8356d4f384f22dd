# SPDX-License-Identifier: BSD-3-Clause
"""The executable ``behavior_tool``: its commands."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

from flexbt_tools.cli import run_command

from . import check, draw, show

EXIT_CODES: Final = (
    ('0', 'nothing is wrong'),
    ('1', 'check: something is wrong'),
    ('2', 'wrong usage, or something is missing on this computer'),
    ('3', 'a file cannot be used; the reasons are printed'),
    ('130', 'interrupted'),
)

COMMANDS: Final = (
    ('check', check, 'find what is wrong, and what is suspicious, in behaviors and their trees'),
    ('show', show, 'show the state machine of a behavior as text'),
    ('draw', draw, 'draw a behavior with its trees'),
)


def main(words: Sequence[str] | None = None) -> int:
    """Runs ``behavior_tool`` and gives its exit code."""
    return run_command('behavior_tool', 'Behaviors, built but not run.', COMMANDS, EXIT_CODES, words)
