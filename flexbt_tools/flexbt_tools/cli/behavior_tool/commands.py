# SPDX-License-Identifier: BSD-3-Clause
"""The executable ``behavior_tool``: its commands."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

from flexbt_tools.cli import run_command

from . import check, draw, show, skills

EXIT_CODES: Final = (
    ('0', 'nothing is wrong'),
    (
        '1',
        'check: there are errors, or with --strict warnings; prove: something is wrong; synthesize: no machine can do '
        'it',
    ),
    ('2', 'wrong usage, or something is missing on this computer'),
    ('3', 'a file cannot be used; the reasons are printed'),
    ('5', 'synthesize: no answer within the time limit; prove: nothing is wrong so far, but not all was followed'),
    ('6', 'prove: nothing goes wrong, but an outcome, a state, a node or the success of a tree can never be reached'),
    ('130', 'interrupted'),
)

COMMANDS: Final = (
    ('check', check, 'find what is wrong, and what is suspicious, in behaviors and their trees'),
    ('show', show, 'show the state machine of a behavior as text'),
    ('skills', skills, 'check manifests of states, show them, or make capabilities of them'),
    ('prove', None, 'follow all that can happen to a behavior, and tell what is wrong'),
    ('draw', draw, 'draw a behavior with its trees'),
    (
        'synthesize',
        None,
        'make a state machine that reaches a goal, from capabilities, or tell why there is none',
    ),
)


def main(words: Sequence[str] | None = None) -> int:
    """Runs ``behavior_tool`` and gives its exit code."""
    return run_command('behavior_tool', 'Behaviors, made and built but not run.', COMMANDS, EXIT_CODES, words)
