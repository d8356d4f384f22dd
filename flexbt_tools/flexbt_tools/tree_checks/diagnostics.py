# SPDX-License-Identifier: BSD-3-Clause
"""Findings of ``check``: warnings, and errors, for which the engine rejects a file."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from enum import Enum
from typing import Any, Final

from flexbt_core.behavior_tree.model.errors import LoadError
from flexbt_core.values.text import one_line


class CheckSeverity(Enum):
    """The severity of a finding: an error fails in each run that reaches it, a warning may be intended."""

    ERROR = 'error'
    WARNING = 'warning'
    INFO = 'info'


ERROR, WARNING, INFO = CheckSeverity


@dataclass(frozen=True, slots=True)
class CheckRule:
    """A kind of finding. ``name`` is the value for ``--ignore``."""

    name: str
    severity: CheckSeverity
    summary: str


def rules_of(values: Iterable[object]) -> tuple[CheckRule, ...]:
    """Return the rules among the values of a module, errors first."""
    order = list(CheckSeverity)
    rules = dict.fromkeys(value for value in values if isinstance(value, CheckRule))
    return tuple(sorted(rules, key=lambda rule: order.index(rule.severity)))


REFUSED: Final = CheckRule('refused', ERROR, 'the engine refuses it')
ODDITY: Final = CheckRule('oddity', WARNING, 'the reader takes it, but it is not what it may look like')
NEVER_WRITTEN: Final = CheckRule(
    'never-written', ERROR, 'a key is read that nothing writes, and that is no input of the tree'
)
UNDECLARED: Final = CheckRule(
    'undeclared', WARNING, 'a key is read that nothing writes, in a tree that may be a sub-tree of other files'
)
LOST_WRITE: Final = CheckRule(
    'lost-write', WARNING, 'a key is written that nothing reads, and who should read it reads another one'
)
NEVER_READ: Final = CheckRule('never-read', INFO, 'a key is written that nothing reads')
UNREACHABLE: Final = CheckRule('unreachable', WARNING, 'a child is never ticked')
TOO_SHORT: Final = CheckRule('too-short', WARNING, 'a time limit is over before what is in it can succeed')
UNUSED_PORT: Final = CheckRule('unused-port', WARNING, 'a sub-tree is given a port that it does not use')
TYPE_CLASH: Final = CheckRule('type-clash', WARNING, 'what is written to a key is not what is read from it')
CROSSED: Final = CheckRule('crossed', WARNING, 'what is given to a port, or a child, is what another one should get')
INCOMPLETE: Final = CheckRule('incomplete', WARNING, 'a node has a number of children with which it cannot be ticked')
UNUSED_TREE: Final = CheckRule('unused-tree', WARNING, 'a tree is neither the main one nor a sub-tree')
MISNAMED: Final = CheckRule('misnamed', WARNING, 'a leaf or sub-tree has the name of another type or tree')
TWICE: Final = CheckRule('twice', WARNING, 'the same stands twice in a row in a sequence')
SHARED_RESOURCE: Final = CheckRule('shared-resource', WARNING, 'what may run at the same time needs the same actuator')
MISSION: Final = CheckRule('mission', WARNING, 'a mission cannot be read, or its goal not be reached')

RULES: Final = rules_of(list(globals().values()))


@dataclass(frozen=True, slots=True)
class Diagnostic:
    """One finding, at its place."""

    rule: CheckRule
    place: LoadError

    def __str__(self) -> str:
        """Return ``file:line:column: severity: node: message [rule]``, the format of compilers."""
        place = self.place
        node = f'{place.node}: ' if place.node else ''
        rule = '' if self.rule is REFUSED else f' [{self.rule.name}]'
        return one_line(
            f'{place.file}:{place.line}:{place.column}: {self.rule.severity.value}: {node}{place.message}{rule}'
        )

    def to_json(self) -> dict[str, Any]:
        place = self.place
        return {
            'file': place.file,
            'line': place.line,
            'column': place.column,
            'severity': self.rule.severity.value,
            'rule': self.rule.name,
            'node': place.node,
            'message': place.message,
        }
