# SPDX-License-Identifier: BSD-3-Clause
"""What ``behavior_tool check`` finds in a behavior."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final

from flexbt_core.values import one_line
from flexbt_tools.tree_checks import SHARED_RESOURCE, TOO_SHORT, Diagnostic, Rule, Severity

REFUSED: Final = Rule('refused', Severity.ERROR, 'the executive refuses to start it')
NO_TREE: Final = Rule('no-tree', Severity.ERROR, 'a tree is run that no file has')
BROKEN_TREE: Final = Rule('broken-tree', Severity.ERROR, 'the BT server refuses a tree file')
KEY_CLASH: Final = Rule('key-clash', Severity.ERROR, 'a state and a tree have different types for a blackboard key')
UNWRITTEN_KEY: Final = Rule('unwritten-key', Severity.ERROR, 'a blackboard key is read that nothing writes')
NO_END: Final = Rule('no-end', Severity.WARNING, 'a state from which no outcome of its machine can be reached')
DEAD_OUTCOME: Final = Rule('dead-outcome', Severity.WARNING, 'an outcome of a machine to which nothing leads')
ENDLESS_LOOP: Final = Rule('endless-loop', Severity.WARNING, 'a loop that waits for nothing: operator, time or world')
UNSURE_READ: Final = Rule('unsure-read', Severity.WARNING, 'userdata is read that is not written on every way there')
WRITE_RACE: Final = Rule('write-race', Severity.WARNING, 'userdata that several states write at the same time')
LOST_WRITE: Final = Rule(
    'lost-write', Severity.WARNING, 'userdata, or a blackboard key, is written, and does not get to who should read it'
)
UNHEARD: Final = Rule(
    'unheard-failure', Severity.WARNING, 'the failure of a child of a concurrency container, of which no condition is'
)
CROSSED_WAYS: Final = Rule(
    'crossed-ways', Severity.WARNING, 'success leads where failure should, and the other way round'
)
OTHER_TREE: Final = Rule(
    'other-tree', Severity.WARNING, 'a state is called after another tree than the one that it runs'
)
UNREAD_KEY: Final = Rule('unread-key', Severity.WARNING, 'a state writes a blackboard key that nothing reads')
SKILL: Final = Rule('skill', Severity.WARNING, 'a machine is not as the skills of its states say')
ALWAYS_ASKS: Final = Rule('always-asks', Severity.INFO, 'a transition that needs the operator at every level')

RULES: Final = (
    REFUSED,
    NO_TREE,
    BROKEN_TREE,
    KEY_CLASH,
    UNWRITTEN_KEY,
    NO_END,
    DEAD_OUTCOME,
    ENDLESS_LOOP,
    UNSURE_READ,
    WRITE_RACE,
    LOST_WRITE,
    UNHEARD,
    CROSSED_WAYS,
    OTHER_TREE,
    UNREAD_KEY,
    TOO_SHORT,
    SHARED_RESOURCE,
    SKILL,
    ALWAYS_ASKS,
)


@dataclass(frozen=True, slots=True)
class Finding:
    """Something that is wrong, or suspicious. ``path`` is the state or machine that it is about, '' for none;
    ``place`` is where it was found in a tree file."""

    rule: Rule
    path: str
    message: str
    place: Diagnostic | None = None

    def text(self, behavior: str) -> str:
        """``behavior: /path: severity: message [rule]``; for a tree file its place stands in front."""
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
