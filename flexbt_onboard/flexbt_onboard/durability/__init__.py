# SPDX-License-Identifier: BSD-3-Clause
"""What the executive knows of a run and of commands after a crash."""

from .journal import REMEMBERED_COMMANDS, Journal, JournalState, encode_line
from .plain_form import from_plain_form, to_plain_form
from .run_journal import CommandAnswer, Decided, InterruptedRun, RunJournal

__all__ = [
    'REMEMBERED_COMMANDS',
    'CommandAnswer',
    'Decided',
    'InterruptedRun',
    'Journal',
    'JournalState',
    'RunJournal',
    'encode_line',
    'from_plain_form',
    'to_plain_form',
]
