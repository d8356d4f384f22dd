# SPDX-License-Identifier: BSD-3-Clause
"""Findings of ``check``: warnings, and errors, for which the engine rejects a file."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from enum import Enum
from typing import Final

from flexbt_core.behavior_tree.model.errors import LoadError
from flexbt_core.values.findings import FindingRecord, finding_record
from flexbt_core.values.text import one_line
from flexbt_tools.errors import RefusedError, ToolError, UsageError


class CheckSeverity(Enum):
    """The severity of a finding: an error fails in each run that reaches it, a warning may be intended."""

    ERROR = 'error'
    WARNING = 'warning'
    INFO = 'info'


ERROR, WARNING, INFO = CheckSeverity


@dataclass(frozen=True, slots=True)
class CheckRule:
    """A kind of finding. ``name`` is the value for ``--ignore``. ``fix`` says what usually helps."""

    name: str
    severity: CheckSeverity
    summary: str
    fix: str = ''


def rules_of(values: Iterable[object]) -> tuple[CheckRule, ...]:
    """Return the rules among the values of a module, errors first."""
    order = list(CheckSeverity)
    rules = dict.fromkeys(value for value in values if isinstance(value, CheckRule))
    return tuple(sorted(rules, key=lambda rule: order.index(rule.severity)))


REFUSED: Final = CheckRule('refused', ERROR, 'the engine refuses it')
ODDITY: Final = CheckRule('oddity', WARNING, 'the reader takes it, but it is not what it may look like')
NEVER_WRITTEN: Final = CheckRule(
    'never-written',
    ERROR,
    'a key is read that nothing writes, and that is not an input of the tree',
    'write the key before it is read, or declare it as an input of the tree',
)
UNDECLARED: Final = CheckRule(
    'undeclared',
    WARNING,
    'a key is read that nothing writes, in a tree that may be a sub-tree of other files',
    'declare the key as an input_port in a TreeNodesModel',
)
LOST_WRITE: Final = CheckRule(
    'lost-write',
    WARNING,
    'a key is written that nothing reads, and who should read it reads another one',
    'use one key for both',
)
NEVER_READ: Final = CheckRule(
    'never-read',
    INFO,
    'a key is written that nothing reads',
    'leave the key out if nothing outside of the tree reads it',
)
UNREACHABLE: Final = CheckRule(
    'unreachable', WARNING, 'a child is never ticked', 'leave the child out, or change what keeps it from being ticked'
)
TOO_SHORT: Final = CheckRule(
    'too-short',
    WARNING,
    'a time limit is over before what is in it can succeed',
    'raise the time limit, or shorten what is in it',
)
UNUSED_PORT: Final = CheckRule(
    'unused-port',
    WARNING,
    'a sub-tree is given a port that it does not use',
    'give the port the name of a key of the sub-tree, or leave it out',
)
TYPE_CLASH: Final = CheckRule(
    'type-clash',
    WARNING,
    'what is written to a key is not what is read from it',
    'write a value of the type that the reader needs',
)
CROSSED: Final = CheckRule(
    'crossed', WARNING, 'what is given to a port, or a child, is what another one should get', 'exchange the two'
)
INCOMPLETE: Final = CheckRule(
    'incomplete',
    WARNING,
    'a node has a number of children with which it cannot be ticked',
    'give the node the number of children that it needs',
)
UNUSED_TREE: Final = CheckRule(
    'unused-tree',
    WARNING,
    'a tree is neither the main one nor a sub-tree',
    'refer to the tree by a SubTree, or remove it',
)
MISNAMED: Final = CheckRule(
    'misnamed',
    WARNING,
    'a leaf or sub-tree has the name of another type or tree',
    'rename it, or use the type whose name it has',
)
TWICE: Final = CheckRule('twice', WARNING, 'the same stands twice in a row in a sequence', 'remove one of the two')
SHARED_RESOURCE: Final = CheckRule(
    'shared-resource', WARNING, 'what may run at the same time needs the same actuator', 'run one after the other'
)
MISSION: Final = CheckRule(
    'mission', WARNING, 'a mission cannot be read, or its goal not be reached', 'correct the mission or its goal'
)

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

    def to_json(self) -> FindingRecord:
        place = self.place
        return finding_record(
            self.rule.name,
            self.rule.severity.value,
            place.message,
            file=place.file,
            start=(place.line, place.column),
            end=place.end,
            node=place.node,
            fix='' if '; ' in place.message else self.rule.fix,
        )


def error_records(error: ToolError) -> list[FindingRecord]:
    """Return an error of a command as findings: one for each of its reasons."""
    if isinstance(error, RefusedError):
        return [Diagnostic(REFUSED, reason).to_json() for reason in error.errors]
    rule = 'usage' if isinstance(error, UsageError) else REFUSED.name
    return [finding_record(rule, ERROR.value, line) for line in str(error).splitlines()]
