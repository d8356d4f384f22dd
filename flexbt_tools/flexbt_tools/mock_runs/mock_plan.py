# SPDX-License-Identifier: BSD-3-Clause
"""Plans of mocks, read from YAML files and from the command line.

::

    blackboard:
      speed: 0.5
    mocks:
      IsBatteryLow: FAILURE                     # the ID of a node type, a name or a path: what its nodes give
      ComputePathToPose:                        # one step for each activation; the last one is repeated
        - {gives: FAILURE, reason: no path}
        - {gives: SUCCESS, after: 1.5, outputs: {path: "json:{}"}}
      left_arm/grasp: [RUNNING]                 # never ends
      PathShorterThan: real                     # the installed node itself
      DistanceController: pass                  # a decorator that only ticks its child
      Clear*: SUCCESS                           # all other leaves that need a mock
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from fnmatch import fnmatchcase
from typing import Any, Final

import yaml

from flexbt_core.behavior_tree.model.errors import LoadError
from flexbt_core.behavior_tree.model.status import NodeStatus
from flexbt_core.values.json_data import finite_number
from flexbt_core.values.text import did_you_mean, short_repr, truncate_middle
from flexbt_core.values.text_files import TextFileError, read_text
from flexbt_core.values.yaml_data import YamlError, YamlParts, compose_yaml, load_yaml
from flexbt_tools.errors import RefusedError, UsageError

REAL: Final = 'real'
PASS: Final = 'pass'  # noqa: S105
_STATUSES: Final = tuple(status.name for status in NodeStatus if status is not NodeStatus.IDLE)
_STEP_KEYS: Final = ('gives', 'after', 'outputs', 'reason')


@dataclass(frozen=True, slots=True)
class MockStep:
    """One activation: RUNNING for ``after`` seconds, then ``gives``.

    ``outputs``, by port, are written at its end. ``reason`` is the reason of a failure.
    """

    gives: NodeStatus
    after: float = 0.0
    outputs: Mapping[str, Any] = field(default_factory=dict)
    reason: str = ''


@dataclass(frozen=True, slots=True)
class MockRule:
    """The plan for the nodes that match ``pattern``.

    They follow ``steps``, or are ``REAL``, or with ``PASS`` tick only their child. ``place`` is where the rule is
    written.
    """

    pattern: str
    does: tuple[MockStep, ...] | str
    place: LoadError

    @property
    def is_wildcard(self) -> bool:
        return '*' in self.pattern or '?' in self.pattern

    def matches(self, name: str) -> bool:
        # Of the characters of file patterns, only * and ? are special here.
        return fnmatchcase(name, self.pattern.replace('[', '[[]')) if self.is_wildcard else name == self.pattern


@dataclass(slots=True)
class MockPlan:
    """Rules in the order of precedence, and the initial contents of the blackboard."""

    rules: list[MockRule] = field(default_factory=list)
    blackboard: dict[str, Any] = field(default_factory=dict)


def read_plan(mocks: list[str], values: list[str]) -> MockPlan:
    """Return the plan of the command line.

    ``mocks`` are files and ``PATTERN=STATUS,...``, ``values`` are ``KEY=VALUE``. The command line takes precedence over
    files. Raises RefusedError or UsageError.
    """
    plan = MockPlan()
    errors: list[LoadError] = []
    for word in mocks:
        if '=' in word:
            plan.rules.append(_rule_of_word(word))
    for word in mocks:
        if '=' not in word:
            reader = _Reader(word)
            reader.read(plan)
            errors += reader.errors
    if errors:
        raise RefusedError(errors)
    for word in values:
        key, equals, text = word.partition('=')
        if not key or not equals:
            raise UsageError(f'--set {word}: expected KEY=VALUE')
        plan.blackboard[key] = _value_of_word(word, text)
    return plan


def _rule_of_word(word: str) -> MockRule:
    pattern, _, names = word.rpartition('=')
    place = LoadError('--mock', 1, 1, '', word)
    if names in (REAL, PASS):
        return MockRule(pattern, names, place)
    for name in names.split(','):
        if name not in _STATUSES:
            raise UsageError(f'--mock {word}: {_no_status(name)}')
    return MockRule(pattern, tuple(MockStep(NodeStatus[name]) for name in names.split(',')), place)


def _value_of_word(word: str, text: str) -> Any:
    try:
        return load_yaml(text, aliases=True)
    except YamlError as error:
        raise UsageError(f'--set {truncate_middle(word)}: {error.reason}') from error


def _no_status(name: object) -> str:
    remedy = did_you_mean(str(name).upper(), _STATUSES, f'; expected one of {", ".join(_STATUSES)}')
    return f'{short_repr(name)} is not a status{remedy}'


class _Reader(YamlParts):
    """A reader of one file, which adds problems to ``errors`` and continues."""

    def __init__(self, file: str) -> None:
        super().__init__(file)
        self.errors: list[LoadError] = []

    def problem(self, node: yaml.Node, text: str) -> None:
        self.errors.append(self._place(node, text))

    def read(self, plan: MockPlan) -> None:
        try:
            root = compose_yaml(read_text(self.source), aliases=True)
        except YamlError as error:
            self.errors.append(LoadError(self.source, error.line, error.column, '', error.reason))
            return
        except TextFileError as error:
            self.errors.append(LoadError(self.source, 1, 1, '', f'cannot be read: {error}'))
            return
        if root is None:
            problem = 'the file is empty; expected mocks: {PATTERN: STATUS}'
            self.errors.append(LoadError(self.source, 1, 1, '', problem))
        for key, value in self.mapping(root, 'the file').items():
            if key == 'blackboard':
                plan.blackboard.update(self.values(value, key))
            elif key == 'mocks':
                plan.rules += [self._rule(pattern, inner) for pattern, inner in self.mapping(value, key).items()]
            else:
                self.problem(value, f'{key!r} means nothing here; expected mocks or blackboard')

    def _rule(self, pattern: str, node: yaml.Node) -> MockRule:
        place = self._place(node, '')
        if isinstance(node, yaml.ScalarNode) and node.value in (REAL, PASS):
            return MockRule(pattern, node.value, place)
        nodes = node.value if isinstance(node, yaml.SequenceNode) else [node]
        if not nodes:
            self.problem(node, f'{pattern!r} has no step; write a status, or a list of them')
        return MockRule(pattern, tuple(self._step(pattern, inner) for inner in nodes), place)

    def _step(self, pattern: str, node: yaml.Node) -> MockStep:
        if not isinstance(node, yaml.MappingNode):
            return MockStep(self._status(node))
        parts = self.mapping(node, f'a step of {pattern!r}')
        for key in parts.keys() - set(_STEP_KEYS):
            self.problem(parts[key], f'{key!r} means nothing in a step; expected {", ".join(_STEP_KEYS)}')
        if 'gives' not in parts:
            self.problem(node, f'a step of {pattern!r} does not say what it gives: gives: SUCCESS')
        return MockStep(
            self._status(parts['gives']) if 'gives' in parts else NodeStatus.FAILURE,
            self._seconds(parts['after']) if 'after' in parts else 0.0,
            self.values(parts['outputs'], 'outputs') if 'outputs' in parts else {},
            str(self.value(parts['reason'], 'reason')) if 'reason' in parts else '',
        )

    def _status(self, node: yaml.Node) -> NodeStatus:
        name = node.value if isinstance(node, yaml.ScalarNode) else self.value(node, 'a status')
        if name in _STATUSES:
            return NodeStatus[name]
        self.problem(node, _no_status(name))
        return NodeStatus.FAILURE

    def _seconds(self, node: yaml.Node) -> float:
        value = self.value(node, 'after')
        seconds = finite_number(value)
        if seconds is not None and seconds >= 0.0:
            return seconds
        self.problem(node, f'{short_repr(value)} is not a duration in seconds')
        return 0.0

    def _place(self, node: yaml.Node, message: str) -> LoadError:
        begin, end = node.start_mark, node.end_mark
        return LoadError(self.source, begin.line + 1, begin.column + 1, '', message, end=(end.line + 1, end.column + 1))
