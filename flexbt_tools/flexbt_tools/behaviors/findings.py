# SPDX-License-Identifier: BSD-3-Clause
"""Findings of ``behavior_tool check``."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, Final

from flexbt_core.values.findings import FindingRecord, finding_record
from flexbt_core.values.text import one_line
from flexbt_tools.tree_checks.diagnostics import (
    ERROR,
    INFO,
    SHARED_RESOURCE,
    TOO_SHORT,
    WARNING,
    CheckRule,
    Diagnostic,
    rules_of,
)

REFUSED: Final = CheckRule('refused', ERROR, 'the executive refuses to start it')
NO_TREE: Final = CheckRule(
    'no-tree', ERROR, 'a tree is run that no file has', 'run a tree of one of the files, or load the file that has it'
)
BROKEN_TREE: Final = CheckRule('broken-tree', ERROR, 'the BT server refuses a tree file', 'correct the tree file')
KEY_CLASH: Final = CheckRule(
    'key-clash', ERROR, 'a state and a tree have different types for a blackboard key', 'use one type on both sides'
)
UNWRITTEN_KEY: Final = CheckRule(
    'unwritten-key',
    ERROR,
    'a blackboard key is read that nothing writes',
    'let a state or a tree write the key before, or give it from outside',
)
NO_END: Final = CheckRule(
    'no-end',
    WARNING,
    'a state from which no outcome of its machine can be reached',
    'lead a transition from there to an outcome of the machine',
)
DEAD_OUTCOME: Final = CheckRule(
    'dead-outcome',
    WARNING,
    'an outcome of a machine to which nothing leads',
    'lead a transition to the outcome, or remove it',
)
ENDLESS_LOOP: Final = CheckRule(
    'endless-loop',
    WARNING,
    'a loop that waits for nothing: operator, time or world',
    'wait in the loop, or limit how often it goes round',
)
UNSURE_READ: Final = CheckRule(
    'unsure-read',
    WARNING,
    'userdata is read that is not written on every way there',
    'write the key on every way to the state, or give it an initial value',
)
WRITE_RACE: Final = CheckRule(
    'write-race', WARNING, 'userdata that several states write at the same time', 'give each state a key of its own'
)
LOST_WRITE: Final = CheckRule(
    'lost-write',
    WARNING,
    'userdata, or a blackboard key, is written, and does not get to who should read it',
    'use one key for both, and remap it where it crosses machines',
)
UNHEARD: Final = CheckRule(
    'unheard-failure',
    WARNING,
    'the failure of a child of a concurrency container, of which no condition is',
    'add a condition for the failure',
)
CROSSED_WAYS: Final = CheckRule(
    'crossed-ways',
    WARNING,
    'success leads where failure should, and the other way round',
    'exchange the two transitions',
)
OTHER_TREE: Final = CheckRule(
    'other-tree',
    WARNING,
    'a state is called after another tree than the one that it runs',
    'run that tree, or rename the state',
)
UNREAD_KEY: Final = CheckRule(
    'unread-key',
    WARNING,
    'a state writes a blackboard key that nothing reads',
    'leave the key out, or let a tree read it',
)
SKILL: Final = CheckRule(
    'skill',
    WARNING,
    'a machine is not as the skills of its states say',
    'change the transition, or correct the skill of the state',
)
ALWAYS_ASKS: Final = CheckRule(
    'always-asks',
    INFO,
    'a transition that needs the operator at every level',
    'require a lower level of autonomy if the operator need not confirm it',
)

RULES: Final = rules_of([*globals().values(), TOO_SHORT, SHARED_RESOURCE])


@dataclass(frozen=True, slots=True)
class Finding:
    """An error or something suspicious.

    ``path`` is the state or machine concerned, '' for none. ``place`` is the position in a tree file, and ``record``
    the finding as it was made elsewhere.
    """

    rule: CheckRule
    path: str
    message: str
    place: Diagnostic | None = None
    record: FindingRecord | None = field(default=None, compare=False)

    def text(self, behavior: str) -> str:
        """Return ``behavior: /path: severity: message [rule]``, for a tree file with its place in front."""
        where = ': '.join(part for part in (behavior, self.path) if part)
        if self.record is not None and self.record['file']:
            place = f'{self.record["file"]}:{self.record["line"]}:{self.record["column"]}'
            return one_line(f'{place}: {self.rule.severity.value}: {self.message} [{self.rule.name}]')
        if self.place is not None:
            return one_line(f'{self.place}  (used by {where})')
        return one_line(f'{where}: {self.rule.severity.value}: {self.message} [{self.rule.name}]')

    def to_json(self, behavior: str) -> dict[str, Any]:
        if self.place is not None:
            record = self.place.to_json()
        elif self.record is not None:
            record = self.record
        else:
            fix = '' if '; ' in self.message else self.rule.fix
            record = finding_record(self.rule.name, self.rule.severity.value, self.message, node=self.path, fix=fix)
        return {**record, 'behavior': behavior, 'path': self.path}
