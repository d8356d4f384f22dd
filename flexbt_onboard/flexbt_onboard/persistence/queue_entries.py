# SPDX-License-Identifier: BSD-3-Clause
"""The entries of the mission queue, and the changes by which the journal describes the queue.

A change is a JSON list that begins with its name:

- ``["put", ENTRY]``: add an entry behind the others of its priority, or replace the one of the same number.
- ``["update", NUMBER, FIELDS]``: set fields of an entry: those of :data:`UPDATED`.
- ``["drop", NUMBER]``: remove an entry.
- ``["move", NUMBER, BEFORE]``: move an entry before another one of its priority; 0: behind all of these.
- ``["hold", NUMBER, REASON]``: hold the queue. ``["release"]``: end the hold.
- ``["ended", NUMBER, OUTCOME, MESSAGE, IS_FORCED]``: a run of an entry has ended, and the entry does not know yet.
  ``["settled"]``: it knows.
- ``["numbers", ENTRY, HOLD]``: the greatest numbers of entries and holds that were ever used.
"""

from __future__ import annotations

import base64
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, field, fields, replace
from typing import Any, Final, NamedTuple

from flexbt_common.values.queue_options import OnFailure, QueueOptions
from flexbt_msgs.msg import BlackboardEntry

Change = list[Any]
"""A change of the queue; see the module."""

Changes = Sequence[Change]

UPDATED: Final = frozenset({'runs', 'failures', 'outcome', 'message', 'due', 'count'})
"""Fields that a change sets after a run. ``count`` is a field of the options."""


@dataclass(frozen=True)
class QueueEntry:
    """An entry of the queue; see QueueEntry.msg. ``added`` and ``due`` are times on the executive's clock, s."""

    number: int
    behavior: str
    options: QueueOptions = field(default_factory=QueueOptions)
    arguments: tuple[tuple[str, str], ...] = ()
    inputs: tuple[BlackboardEntry, ...] = ()
    autonomy: int = 0
    operator: str = ''
    added: float = 0.0
    revision: int = 0
    runs: int = 0
    failures: int = 0
    outcome: str = ''
    message: str = ''
    due: float = 0.0

    def to_plain(self) -> dict[str, Any]:
        """Return the entry as JSON data."""
        plain = {one.name: getattr(self, one.name) for one in fields(self)}
        plain['options'] = {**asdict(self.options), 'wanted': list(self.options.wanted)}
        plain['arguments'] = [list(argument) for argument in self.arguments]
        plain['inputs'] = [
            [one.key, one.type, one.text, base64.b64encode(bytes(one.data)).decode()] for one in self.inputs
        ]
        return plain

    @property
    def size(self) -> int:
        """Bytes and characters of what it was given."""
        texts = [text for argument in self.arguments for text in argument]
        texts += [text for one in self.inputs for text in (one.key, one.type, one.text, one.data)]
        return sum(map(len, texts))


class EndedRun(NamedTuple):
    """A run of an entry that has ended. An empty outcome: it could not start."""

    number: int
    outcome: str
    message: str
    is_forced: bool = False


@dataclass
class QueueState:
    """The queue that the changes describe, the entries in their order: by priority, then as added or moved."""

    entries: dict[int, QueueEntry] = field(default_factory=dict)
    hold: int = 0
    held: str = ''
    ended: EndedRun | None = None
    last_entry: int = 0
    last_hold: int = 0

    def copy(self) -> QueueState:
        """Return a copy that changes independently."""
        return replace(self, entries=dict(self.entries))

    def apply(self, changes: Changes) -> None:
        """Apply changes. Changes of unknown entries do nothing.

        Raises:
            ValueError: one is none of the changes in the module.
        """
        for change in changes:
            match change:
                case ['put', dict(plain)]:
                    self._put(_entry_of(plain))
                case ['update', int(number), dict(values)] if values.keys() <= UPDATED:
                    self._update(number, values)
                case ['drop', int(number)]:
                    self.entries.pop(number, None)
                case ['move', int(number), int(before)]:
                    self._move(number, before)
                case ['hold', int(number), str(reason)]:
                    self.hold, self.held = number, reason
                    self.last_hold = max(self.last_hold, number)
                case ['release']:
                    self.hold, self.held = 0, ''
                case ['ended', int(number), str(outcome), str(message), bool(is_forced)]:
                    self.ended = EndedRun(number, outcome, message, is_forced)
                case ['settled']:
                    self.ended = None
                case ['numbers', int(entry), int(hold)]:
                    self.last_entry, self.last_hold = max(self.last_entry, entry), max(self.last_hold, hold)
                case _:
                    raise ValueError('is no change of the queue')

    def changes(self) -> Changes:
        """Return the smallest list of changes that describes the same state."""
        made: list[Change] = [['put', entry.to_plain()] for entry in self.entries.values()]
        if self.hold:
            made.append(['hold', self.hold, self.held])
        if self.ended is not None:
            made.append(['ended', *self.ended])
        if self.last_entry or self.last_hold:
            made.append(['numbers', self.last_entry, self.last_hold])
        return made

    def _put(self, entry: QueueEntry) -> None:
        self.last_entry = max(self.last_entry, entry.number)
        known = self.entries.get(entry.number)
        self.entries[entry.number] = entry
        if known is None or known.options.priority != entry.options.priority:
            self._move(entry.number, 0)

    def _update(self, number: int, values: Mapping[str, Any]) -> None:
        entry = self.entries.get(number, QueueEntry(number, ''))
        own = {name: value for name, value in values.items() if name != 'count'}
        options = replace(entry.options, count=values.get('count', entry.options.count))
        changed = _checked(replace(entry, options=options, **own))
        if number in self.entries:
            self.entries[number] = changed

    def _move(self, number: int, before: int) -> None:
        """Place an entry; the order stays that of the priorities."""
        moved = self.entries.pop(number, None)
        if moved is None:
            return
        priority = moved.options.priority
        others = list(self.entries.values())
        place = next((at for at, one in enumerate(others) if one.options.priority < priority), len(others))
        for at, one in enumerate(others):
            if one.number == before and one.options.priority == priority:
                place = at
        others.insert(place, moved)
        self.entries = {one.number: one for one in others}


def are_changes(value: Any) -> bool:
    """Return whether JSON data are changes of a queue."""
    if not isinstance(value, list):
        return False
    try:
        QueueState().apply(value)
    except ValueError:
        return False
    return True


def _entry_of(plain: Mapping[str, Any]) -> QueueEntry:
    """Return the entry of JSON data. Raise ValueError if it is none."""
    try:
        options = {**plain['options'], 'wanted': tuple(plain['options']['wanted'])}
        options['on_failure'] = OnFailure(options['on_failure'])
        given = {
            **plain,
            'options': QueueOptions(**options),
            'arguments': tuple((name, value) for name, value in plain['arguments']),
            'inputs': tuple(
                BlackboardEntry(key=key, type=type, text=text, data=base64.b64decode(data, validate=True))
                for key, type, text, data in plain['inputs']
            ),
        }
        return _checked(QueueEntry(**given))
    except (TypeError, KeyError, AssertionError, UnicodeError) as error:
        raise ValueError(f'is no entry of the queue: {error}') from error


def _checked(entry: QueueEntry) -> QueueEntry:
    """Return the entry. Raise ValueError if a field has another type, or cannot be in a message."""
    for one in (entry, entry.options):
        for known in fields(one):
            check = _CHECKS.get(str(known.type))
            if check is not None and not check(getattr(one, known.name)):
                raise ValueError(f'has a {known.name} that cannot be: {getattr(one, known.name)!r:.40}')
    if not all(_is_text(text) for text in [*entry.options.wanted, *sum(entry.arguments, ())]):
        raise ValueError('has a text that cannot be')
    return entry


def _is_text(value: Any) -> bool:
    return isinstance(value, str) and value.encode('utf-8', 'replace').decode() == value


def _is_number(value: Any) -> bool:
    return type(value) in (int, float) and math.isfinite(value) and abs(value) < 2**31


def _is_whole(value: Any) -> bool:
    return type(value) is int and abs(value) < 2**31


_CHECKS: Final[Mapping[str, Callable[[Any], bool]]] = {'int': _is_whole, 'float': _is_number, 'str': _is_text}
"""Checks of fields by their declared type."""
