# SPDX-License-Identifier: BSD-3-Clause
"""The mission queue as the journal has it: its state, its entries, and changes from one state to another.

A change is a JSON object with what is different:

- ``entries``: entries that are new, or have another content.
- ``order``: the numbers of all entries, if there are others or they have another order.
- ``hold``: number and reason of the hold; 0 and '' for none.
- ``ended``: a run of an entry has ended, and the entry does not know yet: see :class:`EndedRun`; null: it knows.
- ``last``: the greatest numbers of entries and holds that were ever used.
"""

from __future__ import annotations

import base64
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, fields, replace
from typing import Any, NamedTuple

from flexbt_common.values import queue_options
from flexbt_common.values.queue_options import OnFailure, QueueOptions
from flexbt_msgs.msg import BlackboardEntry

Change = Mapping[str, Any]
"""A change of the queue; see the module."""


@dataclass(frozen=True)
class QueueEntry(queue_options.QueueEntry):
    """An entry of the queue, with whole values."""

    inputs: tuple[BlackboardEntry, ...] = ()

    def to_plain(self) -> dict[str, Any]:
        """Return the entry as JSON data."""
        inputs = [[one.key, one.type, one.text, base64.b64encode(bytes(one.data)).decode()] for one in self.inputs]
        return {**vars(self), 'options': asdict(self.options), 'inputs': inputs}

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


@dataclass(frozen=True)
class QueueState:
    """The queue: its entries in their order, by priority, then as added or moved."""

    entries: Mapping[int, QueueEntry] = field(default_factory=dict)
    hold: int = 0
    held: str = ''
    ended: EndedRun | None = None
    last_entry: int = 0
    last_hold: int = 0

    def after(self, change: Change) -> QueueState:
        """Return the state after a change. Entries in the order that are not known are left out.

        Raises:
            ValueError: it is none.
        """
        entries, rest = dict(self.entries), dict[str, Any]()
        for name, value in change.items():
            match name, value:
                case 'entries', [*plain]:
                    entries.update((one.number, one) for one in map(_entry_of, plain))
                case 'order', [*numbers] if all(type(one) is int for one in numbers):
                    entries = {number: entries[number] for number in numbers if number in entries}
                case 'hold', [int(number), str(reason)]:
                    rest |= {'hold': number, 'held': reason}
                case 'ended', None | [int(), str(), str(), bool()]:
                    rest['ended'] = None if value is None else EndedRun(*value)
                case 'last', [int(entry), int(hold)]:
                    rest |= {'last_entry': entry, 'last_hold': hold}
                case _:
                    raise ValueError('is no change of the queue')
        return replace(self, entries=entries, **rest)

    def since(self, before: QueueState) -> Change:
        """Return the change that leads here from another state."""
        new = [one.to_plain() for one in self.entries.values() if one is not before.entries.get(one.number)]
        others = _parts(before)
        changed = {name: value for name, value in _parts(self).items() if value != others[name]}
        return {'entries': new, **changed} if new else changed

    def changes(self) -> list[Change]:
        """Return changes that describe the state, one for each entry: what is corrupt in a file is lost alone."""
        whole = dict(self.since(QueueState()))
        return [*({'entries': [one]} for one in whole.pop('entries', ())), *([whole] if whole else ())]


def _parts(state: QueueState) -> Change:
    return {
        'order': [*state.entries],
        'hold': [state.hold, state.held],
        'ended': state.ended and list(state.ended),
        'last': [state.last_entry, state.last_hold],
    }


def is_change(value: Any) -> bool:
    """Return whether JSON data are a change of a queue."""
    try:
        return isinstance(value, dict) and QueueState().after(value) is not None
    except ValueError:
        return False


def _entry_of(plain: Mapping[str, Any]) -> QueueEntry:
    """Return the entry of JSON data.

    Raises:
        ValueError: it is none, or a field has another type, or cannot be in a message.
    """
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
        entry = QueueEntry(**given)
    except (TypeError, KeyError, AssertionError, UnicodeError) as error:
        raise ValueError(f'is no entry of the queue: {error}') from error
    values = [(str(known.type), getattr(one, known.name)) for one in (entry, entry.options) for known in fields(one)]
    values += [('str', text) for text in [*entry.options.wanted, *sum(entry.arguments, ())]]
    for kind, value in values:
        if not _is_of(kind, value):
            raise ValueError(f'has a value that cannot be: {value!r:.40}')
    return entry


def _is_of(kind: str, value: Any) -> bool:
    """Return whether a value has the declared type of a field, and fits into a message."""
    if kind == 'str':
        return isinstance(value, str) and value.encode('utf-8', 'replace').decode() == value
    is_number = type(value) is int or (kind == 'float' and type(value) is float)
    return kind not in ('int', 'float') or (is_number and abs(value) < 2**31)
