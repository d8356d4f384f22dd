# SPDX-License-Identifier: BSD-3-Clause
"""What the executive knows of a run and of commands after a crash."""

from .journal import REMEMBERED_COMMANDS, RETRY_SECONDS, STUCK_SECONDS, Journal, JournalState
from .journal_format import FORMAT, FoundJournal, Line, encode_head, encode_line, read_journal
from .plain_form import from_plain_form, to_plain_form
from .run_journal import REASON_LENGTH, CommandAnswer, Decided, InterruptedRun, RunJournal

__all__ = [
    'FORMAT',
    'REASON_LENGTH',
    'REMEMBERED_COMMANDS',
    'RETRY_SECONDS',
    'STUCK_SECONDS',
    'CommandAnswer',
    'Decided',
    'FoundJournal',
    'InterruptedRun',
    'Journal',
    'JournalState',
    'Line',
    'RunJournal',
    'encode_head',
    'encode_line',
    'from_plain_form',
    'read_journal',
    'to_plain_form',
]
