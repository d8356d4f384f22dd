# SPDX-License-Identifier: BSD-3-Clause
"""The executable ``bt_tool``: its commands."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

from flexbt_tools.cli import run_command

from . import check, draw, log, model, run, show, skills

EXIT_CODES: Final = (
    ('0', 'nothing is wrong; the tree succeeded'),
    (
        '1',
        'check: there are errors, or with --strict warnings; prove, skills: something is wrong; run: the tree did not '
        'succeed; plan: there is no plan',
    ),
    ('2', 'wrong usage, or something is missing on this computer'),
    ('3', 'a file cannot be used; the reasons are printed'),
    ('4', 'run: a node raised an exception, or broke the rules'),
    ('5', 'run, plan: not done in time; prove: nothing is wrong so far, but not all was followed'),
    ('6', 'prove: nothing goes wrong, but the tree can never succeed, or a node can never be reached'),
    ('130', 'interrupted'),
)

COMMANDS: Final = (
    ('check', check, 'find what is wrong, and what is suspicious, in tree files'),
    ('show', show, 'show the trees of a file as text'),
    ('draw', draw, 'draw the trees of a file'),
    ('model', model, 'describe the node types that are known here, for editors'),
    ('skills', skills, 'show what leaves need and bring about, and check files of manifests'),
    ('prove', None, 'follow all that can happen to a tree, or in a model, and tell what is wrong'),
    ('run', run, 'run a tree with mocks, and print what happens'),
    ('plan', None, 'plan a goal, and write a reactive tree that reaches it'),
    ('log', log, 'print a log file (.btlog) of a run'),
)


def main(words: Sequence[str] | None = None) -> int:
    """Runs ``bt_tool`` and gives its exit code, see :class:`flexbt_tools.errors.ExitCode`."""
    return run_command('bt_tool', 'Behavior-tree files, without ROS running.', COMMANDS, EXIT_CODES, words)
