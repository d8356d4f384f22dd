# SPDX-License-Identifier: BSD-3-Clause
"""The file of rules: who is called about which needs of which robots, and the file of contacts.

The addresses of contacts are secrets. No text of this module quotes one, nor anything else of the file of contacts.
"""

from __future__ import annotations

import os
import re
import stat
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from datetime import datetime, time, tzinfo
from enum import IntEnum
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Final, TypeVar
from urllib.parse import urlsplit
from zoneinfo import ZoneInfo

import yaml

from flexbt_console.commands.operator_values import full_namespace, one_of
from flexbt_console.errors import UsageError
from flexbt_console.mirror.fleet import Urgency
from flexbt_core.values.text import did_you_mean, short_repr
from flexbt_core.values.text_files import TextFileError, open_regular, read_text
from flexbt_core.values.yaml_data import YamlError, YamlParts, compose_yaml, line_of

CONDITIONS: Final = {
    'moved': Urgency.ALARM,
    'decision': Urgency.DECISION,
    'failed': Urgency.FAILED,
    'silent': Urgency.UNREACHABLE,
    'fault': Urgency.DEGRADED,
    'incident': Urgency.INCIDENT,
}
"""What a rule may be about, by the name in the file."""

LARGEST_FILE: Final = 1_000_000
LONGEST_ADDRESS: Final = 4_000
"""Bounds of a file, bytes, and of an address, characters."""

ENVIRONMENT: Final = 'FLEXBT_CONTACT_'
"""Prefix of the environment variables with the addresses of a contact, separated by blanks."""

T = TypeVar('T')

_CONDITION: Final = one_of(tuple(CONDITIONS))
_KEYS: Final = ('rules', 'contacts', 'page', 'robots', 'time_zone', 'quiet_hours')
_RULE_KEYS: Final = ('when', 'robots', 'severity', 'for', 'call', 'then', 'over')
_NAME: Final = re.compile(r'[\w.-]{1,64}')
_DURATION: Final = re.compile(r'(\d{1,9}(?:\.\d{1,6})?)\s*(s|min|h)?')
_UNITS: Final = {'s': 1.0, 'min': 60.0, 'h': 3600.0, None: 1.0}
_ADDRESS: Final = re.compile(r'\S*://.*')


class Severity(IntEnum):
    """How bad it is."""

    INFO = 0
    WARNING = 1
    CRITICAL = 2


@dataclass(frozen=True, slots=True)
class Step:
    """People to call: the first ones ``after`` the need has lasted for this time, s, others after the call before."""

    after: float
    contacts: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class Rule:
    """Who is called about these needs of these robots (globs), in turn until somebody acknowledges.

    ``over``: who was called is told when it is over. ``line`` of the file.
    """

    conditions: tuple[Urgency, ...]
    robots: tuple[str, ...]
    severity: Severity
    steps: tuple[Step, ...]
    over: bool
    line: int

    def covers(self, robot: str, condition: Urgency) -> bool:
        """Return whether the rule is for this need."""
        return condition in self.conditions and any(fnmatchcase(robot, glob) for glob in self.robots)


@dataclass(frozen=True, slots=True)
class QuietHours:
    """Time of the day in which nobody is called, ``unless`` it is that severe."""

    begin: time
    end: time
    unless: Severity

    def hold(self, now: datetime) -> bool:
        """Return whether it is quiet at a local time."""
        at = now.time()
        return self.begin <= at < self.end if self.begin < self.end else at >= self.begin or at < self.end


@dataclass(frozen=True, slots=True)
class AlertRules:
    """The rules, of which the first that covers a need counts, the addresses of the contacts, and the files of both."""

    rules: tuple[Rule, ...] = ()
    addresses: Mapping[str, tuple[str, ...]] = field(default_factory=dict, repr=False)
    page: str = ''
    robots: tuple[str, ...] = ()
    zone: tzinfo | None = None
    quiet: QuietHours | None = None
    files: tuple[Path, ...] = ()

    def rule_of(self, robot: str, condition: Urgency) -> Rule | None:
        """Return the rule for a need, or None."""
        return next((rule for rule in self.rules if rule.covers(robot, condition)), None)

    def is_held(self, severity: Severity, now: datetime) -> bool:
        """Return whether a call of this severity has to wait for the end of the quiet hours."""
        return self.quiet is not None and severity < self.quiet.unless and self.quiet.hold(now)


def condition_name(condition: Urgency) -> str:
    """Return the name of a need in the file; '' if no rule can be about it."""
    return next((name for name, one in CONDITIONS.items() if one is condition), '')


def load_rules(file: Path, environment: Mapping[str, str] = os.environ) -> AlertRules:
    """Read the file of rules, and the file of contacts that it names.

    Raises:
        UsageError: they cannot be used; a line for each problem.
    """
    try:
        text = read_text(file, LARGEST_FILE)
    except TextFileError as error:
        raise UsageError(f'{file}: cannot be read: {error}') from None
    parts = _RuleParts(file, environment)
    found = parts.read(text, file)
    if parts.problems:
        # An address that was written here is a secret, too.
        raise UsageError('\n'.join(_ADDRESS.sub('…', problem) for problem in parts.problems))
    return found


class _RuleParts(YamlParts):
    """A reader of the file of rules."""

    def __init__(self, file: Path, environment: Mapping[str, str]) -> None:
        super().__init__(str(file))
        self._environment = environment
        self._contacts: Mapping[str, tuple[str, ...]] | None = {}
        """None if they cannot be read: one problem is enough."""

    def read(self, text: str, file: Path) -> AlertRules:
        entries = self._table(self.root(text), 'the file', _KEYS, ('rules',))
        if 'contacts' in entries:
            self._contacts = self._one(entries, 'contacts', lambda name: _contacts(file, name), None)
        robots = self._several(entries, 'robots', full_namespace, ())
        rules: list[Rule] = []
        for node in self.sequence(entries['rules'], 'rules') if 'rules' in entries else ():
            rules.append(self._rule(node, rules, robots))
        if 'rules' in entries and not rules:
            self.problem(entries['rules'], 'rules: nothing is there, so nobody would be called')
        called = {contact for rule in rules for step in rule.steps for contact in step.contacts}
        return AlertRules(
            tuple(rules),
            {contact: self._addresses(contact) for contact in sorted(called)},
            self._one(entries, 'page', _page, ''),
            robots,
            self._one(entries, 'time_zone', _zone, None),
            self._quiet(entries['quiet_hours']) if 'quiet_hours' in entries else None,
            (file, *(file.parent / one.value for one in [entries.get('contacts')] if isinstance(one, yaml.ScalarNode))),
        )

    def _rule(self, node: yaml.Node, before: Sequence[Rule], known: Sequence[str]) -> Rule:
        parts = self._table(node, 'a rule', _RULE_KEYS, ('when', 'call'))
        conditions = self._several(parts, 'when', lambda name: CONDITIONS[_CONDITION(name)], ())
        robots = self._several(parts, 'robots', _glob, ('*',))
        if known and not any(fnmatchcase(name, glob) for name in known for glob in robots):
            self.problem(node, f'the rule is never used: its robots are none of {", ".join(known)}')
        steps = [Step(self._one(parts, 'for', _duration, 0.0), self._several(parts, 'call', self._contact, ()))]
        for one in self.sequence(parts['then'], 'then') if 'then' in parts else ():
            then = self._table(one, 'a step of "then"', ('after', 'call'), ('after', 'call'))
            steps.append(Step(self._one(then, 'after', _duration, 0.0), self._several(then, 'call', self._contact, ())))
        covered = {(condition, glob) for rule in before for condition in rule.conditions for glob in rule.robots}
        if conditions and all({(one, '*'), (one, glob)} & covered for one in conditions for glob in robots):
            self.problem(node, 'the rule is never used: rules above it cover the same, and the first counts')
        severity = self._one(parts, 'severity', _severity, Severity.WARNING)
        over = self._one(parts, 'over', one_of(('true', 'false')), 'false') == 'true'
        return Rule(conditions, robots, severity, tuple(steps), over, line_of(node))

    def _quiet(self, node: yaml.Node) -> QuietHours:
        parts = self._table(node, 'quiet_hours', ('from', 'to', 'unless'), ('from', 'to'))
        begin, end = (self._one(parts, name, _time_of_day, time()) for name in ('from', 'to'))
        if begin == end and not self.problems:
            self.problem(node, 'quiet_hours: "from" and "to" are the same time')
        return QuietHours(begin, end, self._one(parts, 'unless', _severity, Severity.CRITICAL))

    def _contact(self, name: str) -> str:
        if not _NAME.fullmatch(name):  # perhaps an address
            raise UsageError('give names of contacts; addresses belong into the file of contacts')
        if self._contacts is not None and not self._addresses(name):
            near = did_you_mean(name, self._contacts, f'; write it into the file of contacts, or set {_variable(name)}')
            raise UsageError(f'there is no contact {short_repr(name)}{near}')
        return name

    def _addresses(self, contact: str) -> tuple[str, ...]:
        return (self._contacts or {}).get(contact) or tuple(self._environment.get(_variable(contact), '').split())

    def _table(
        self, node: yaml.Node | None, what: str, keys: Sequence[str], needed: Sequence[str]
    ) -> dict[str, yaml.Node]:
        entries = self.mapping(node, what)
        self.refuse_others(entries, keys, what)
        if node is not None and (lacking := [name for name in needed if name not in entries]):
            self.problem(node, f'{what} needs "{lacking[0]}"')
        return entries

    def _one(self, entries: Mapping[str, yaml.Node], name: str, read: Callable[[str], T], default: T) -> T:
        """Return an entry as ``read`` has it; with a problem, or without the entry, the default."""
        return self._read(entries[name], name, read, default) if name in entries else default

    def _several(
        self, entries: Mapping[str, yaml.Node], name: str, read: Callable[[str], T], default: tuple[T, ...]
    ) -> tuple[T, ...]:
        """Return an entry that is one text or a list."""
        if name not in entries:
            return default
        given = entries[name]
        nodes = [given] if isinstance(given, yaml.ScalarNode) else self.sequence(given, name)
        if not nodes:
            self.problem(given, f'{name}: nothing is named')
        found = (self._read(node, name, read, None) for node in nodes)
        return tuple(dict.fromkeys(one for one in found if one is not None))

    def _read(self, node: yaml.Node, name: str, read: Callable[[str], T], default: T) -> T:
        try:
            return read(self.name(node, name, 'a text'))
        except UsageError as error:
            self.problem(node, f'{name}: {error}')
            return default


def _duration(text: str) -> float:
    if (found := _DURATION.fullmatch(text)) is None:
        raise UsageError(f'{short_repr(text)} is no time such as 30 s, 5 min or 2 h')
    return float(found[1]) * _UNITS[found[2]]


def _severity(text: str) -> Severity:
    return Severity[one_of([one.name.lower() for one in Severity])(text).upper()]


def _glob(text: str) -> str:
    """Return a pattern for the names of robots, which begin with a slash."""
    return text if text.startswith(('/', '*', '?', '[')) else f'/{text}'


def _page(text: str) -> str:
    try:
        parts = urlsplit(text)
        is_usable = parts.scheme in ('http', 'https') and bool(parts.hostname)
    except ValueError:
        is_usable = False
    if not is_usable:
        raise UsageError('give the address of the page: http or https, the computer and the port')
    if '@' in parts.netloc or parts.query or parts.fragment:
        raise UsageError('leave out name, password, token and all behind ? or #: messages are not secret')
    return text.rstrip('/')


def _zone(text: str) -> tzinfo | None:
    try:
        return ZoneInfo(text)
    except (ValueError, OSError, KeyError):
        raise UsageError(f'{short_repr(text)} is not known; give a name such as Europe/Berlin') from None


def _time_of_day(text: str) -> time:
    try:
        return datetime.strptime(text, '%H:%M').time()
    except ValueError:
        raise UsageError(f'{short_repr(text)} is no time of the day such as 22:00') from None


def _variable(contact: str) -> str:
    return ENVIRONMENT + re.sub(r'\W', '_', contact).upper()


def _contacts(rules: Path, name: str) -> dict[str, tuple[str, ...]]:
    """Read the file of contacts, by its name in a file of rules: the addresses of each, in the words of apprise.

    Raises:
        UsageError: it cannot be used, or others may read it.
    """
    if '://' in name:
        raise UsageError('give the name of a file, and write addresses there')
    file = rules.parent / name
    try:
        with open(file, 'rb', opener=open_regular) as content:
            kept = os.fstat(content.fileno())
            if kept.st_uid != os.geteuid():
                raise UsageError(f'{file} belongs to another user: its addresses are secrets; it has to be your own')
            if (mode := stat.S_IMODE(kept.st_mode)) & 0o077:
                raise UsageError(f'{file} has addresses, which are secrets, and mode {mode:o}; do chmod 600 {file}')
            if kept.st_size > LARGEST_FILE:
                raise UsageError(f'{file} is longer than {LARGEST_FILE} bytes; this is not a file of contacts')
            root = compose_yaml(content.read(LARGEST_FILE).decode())
    except (OSError, ValueError) as error:  # the text of the others quotes the file
        at = f':{error.line}' if isinstance(error, YamlError) else ''
        why = (error.strerror or str(error)) if isinstance(error, OSError) else 'this is not YAML'
        raise UsageError(f'{file}{at} cannot be read: {why}') from None
    contacts: dict[str, tuple[str, ...]] = {}
    expected = 'expected a line such as "anna: [address, address]" for each contact'
    if not isinstance(root, yaml.MappingNode):
        raise UsageError(f'{file}: {expected}')
    for key, value in root.value:
        nodes = value.value if isinstance(value, yaml.SequenceNode) else [value]
        texts = [one.value if isinstance(one, yaml.ScalarNode) else '' for one in nodes]
        if not (isinstance(key, yaml.ScalarNode) and _NAME.fullmatch(key.value) and key.value not in contacts):
            raise UsageError(f'{file}:{line_of(key)}: {expected}')
        if not texts or not all(0 < len(text) <= LONGEST_ADDRESS for text in texts):
            most = f'an address, or a list of them, of up to {LONGEST_ADDRESS} characters each'
            raise UsageError(f'{file}:{line_of(value)}: {key.value} needs {most}')
        contacts[key.value] = tuple(dict.fromkeys(texts))
    return contacts


def rule_text(rule: Rule) -> str:
    """Return a rule in words."""
    steps = [f'after {step.after:g} s call {", ".join(step.contacts)}' for step in rule.steps]
    what = f'{", ".join(map(condition_name, rule.conditions))} of {", ".join(rule.robots)}'
    return '; then '.join(
        [f'{what}, {rule.severity.name.lower()}: {steps[0]}', *steps[1:], *['tell them the end'] * rule.over]
    )
