# SPDX-License-Identifier: BSD-3-Clause
"""Findings of ``behavior_tool check``."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final

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
NO_TREE: Final = CheckRule('no-tree', ERROR, 'a tree is run that no file has')
BROKEN_TREE: Final = CheckRule('broken-tree', ERROR, 'the BT server refuses a tree file')
KEY_CLASH: Final = CheckRule('key-clash', ERROR, 'a state and a tree have different types for a blackboard key')
UNWRITTEN_KEY: Final = CheckRule('unwritten-key', ERROR, 'a blackboard key is read that nothing writes')
NO_END: Final = CheckRule('no-end', WARNING, 'a state from which no outcome of its machine can be reached')
DEAD_OUTCOME: Final = CheckRule('dead-outcome', WARNING, 'an outcome of a machine to which nothing leads')
ENDLESS_LOOP: Final = CheckRule('endless-loop', WARNING, 'a loop that waits for nothing: operator, time or world')
UNSURE_READ: Final = CheckRule('unsure-read', WARNING, 'userdata is read that is not written on every way there')
WRITE_RACE: Final = CheckRule('write-race', WARNING, 'userdata that several states write at the same time')
LOST_WRITE: Final = CheckRule(
    'lost-write', WARNING, 'userdata, or a blackboard key, is written, and does not get to who should read it'
)
UNHEARD: Final = CheckRule(
    'unheard-failure', WARNING, 'the failure of a child of a concurrency container, of which no condition is'
)
CROSSED_WAYS: Final = CheckRule('crossed-ways', WARNING, 'success leads where failure should, and the other way round')
OTHER_TREE: Final = CheckRule('other-tree', WARNING, 'a state is called after another tree than the one that it runs')
UNREAD_KEY: Final = CheckRule('unread-key', WARNING, 'a state writes a blackboard key that nothing reads')
SKILL: Final = CheckRule('skill', WARNING, 'a machine is not as the skills of its states say')
ALWAYS_ASKS: Final = CheckRule('always-asks', INFO, 'a transition that needs the operator at every level')

RULES: Final = rules_of([*globals().values(), TOO_SHORT, SHARED_RESOURCE])


@dataclass(frozen=True, slots=True)
class Finding:
    """An error or something suspicious.

    ``path`` is the state or machine concerned, '' for none. ``place`` is the position in a tree file.
    """

    rule: CheckRule
    path: str
    message: str
    place: Diagnostic | None = None

    def text(self, behavior: str) -> str:
        """Return ``behavior: /path: severity: message [rule]``, for a tree file with its place in front."""
        where = ': '.join(part for part in (behavior, self.path) if part)
        if self.place is not None:
            return one_line(f'{self.place}  (used by {where})')
        return one_line(f'{where}: {self.rule.severity.value}: {self.message} [{self.rule.name}]')

    def to_json(self, behavior: str) -> dict[str, Any]:
        place = self.place.to_json() if self.place is not None else {}
        return {
            'behavior': behavior,
            'path': self.path,
            'severity': self.rule.severity.value,
            'rule': self.rule.name,
            'message': self.message,
            **{key: place[key] for key in ('file', 'line', 'column', 'node') if key in place},
        }
