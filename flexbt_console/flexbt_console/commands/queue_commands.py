# SPDX-License-Identifier: BSD-3-Clause
"""The commands of the mission queue: their options, and what they send."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterable, Mapping
from dataclasses import replace
from typing import Any, Final

from flexbt_common.values.queue_options import OnFailure, QueueOptions
from flexbt_console.errors import NoAnswerError, RefusedError, UsageError
from flexbt_console.mirror.mirror import Mirror
from flexbt_console.mirror.records import (
    CommandKind,
    MissionQueue,
    OperatorCommand,
    QueueEntry,
)
from flexbt_console.mirror.view import View
from flexbt_console.present.queue import queue_lines
from flexbt_core.values.text import short_repr

from .command_builder import CommandBuilder, check_behavior
from .effects import start
from .operator_values import assignment, autonomy_level, item_number, run_count, start_input, whole_number
from .spec import CommandLine, Reading, Send, Typed

HOLD_OPTION: Final = '--hold'
"""The option by which a line names the hold that it ends; see MissionQueue.msg."""

WHERE: Final = ('first', 'last')
"""Words for a place in the queue, instead of the number of an entry."""

FAILURES: Final = ('hold', 'continue', 'drop', 'retry=1')
"""What may follow a failure; any number of retries."""

CONDITIONS: Final = ('battery=', 'time=', 'after=', 'near=')
NO_CONDITION: Final = 'none'

_UNITS: Final = {'s': 1.0, 'm': 60.0, 'h': 3600.0, 'd': 86_400.0}
_NEAR: Final = 1.0
_FARTHEST: Final = 1e6
_LATEST: Final = 2.0**31 - 1.0
"""Greatest distance (m), and latest time (s) that a message has room for."""


def duration(text: str) -> float:
    """Read a duration: 90, 90s, 10m, 2h or 1d. Raises UsageError if the text is none of at least 1 s."""
    number, unit = (text[:-1], text[-1:]) if text[-1:] in _UNITS else (text, 's')
    try:
        seconds = float(number) * _UNITS[unit]
    except ValueError:
        seconds = math.nan
    if not 1.0 <= seconds < 1e9:
        raise UsageError(f'{short_repr(text)}: expected a duration of at least 1 s, as in 90s, 10m, 2h or 1d')
    return seconds


def place_in_queue(text: str) -> str:
    """Check a place in the queue: a number, first or last."""
    if text not in WHERE:
        try:
            item_number(text)
        except UsageError:
            raise UsageError(f'{short_repr(text)}: expected {", ".join(WHERE)} or the number of an entry') from None
    return text


def on_failure(text: str) -> tuple[OnFailure, int]:
    """Read what follows a failure, and the number of retries. Raises UsageError."""
    word, equals, number = text.partition('=')
    if word == 'retry':
        return OnFailure.RETRY, whole_number(number, least=1, most=1000) if equals else 1
    names = {one.name.lower(): one for one in (OnFailure.HOLD, OnFailure.CONTINUE, OnFailure.DROP)}
    if text not in names:
        raise UsageError(f'{short_repr(text)}: expected hold, continue, drop or retry=TIMES')
    return names[text], 0


def priority(text: str) -> int:
    """Read a priority. Raises UsageError if it is no whole number from -1000 to 1000."""
    number = text.removeprefix('-')
    return whole_number(number, least=0, most=1000) * (-1 if text != number else 1)


def condition(text: str) -> tuple[str, str]:
    """Check a condition, and return its name and value. Raises UsageError if it is written in another way."""
    name, equals, value = text.partition('=')
    if not equals or not value or f'{name}=' not in CONDITIONS:
        raise UsageError(
            f'{short_repr(text)}: expected battery=PERCENT, time=22:00-06:00, after=+10m, after=2026-01-31T08:00, '
            'near=PLACE or near=PLACE:METRES'
        )
    if value != NO_CONDITION:
        _changes(name, value, 0.0)
    return name, value


def _changes(name: str, value: str, now: float) -> dict[str, Any]:
    """Return the fields of the options that a condition sets; ``now`` is the time of the robot, s."""
    if name == 'battery':
        return {'battery': whole_number(value.removesuffix('%'), least=0, most=100) / 100.0}
    if name == 'time':
        return {'window': value}  # the robot checks it
    if name == 'after':
        moment = now + duration(value[1:]) if value.startswith('+') else _moment(value)
        if not 0.0 <= moment < _LATEST:
            raise UsageError(f'{short_repr(value)}: expected a time from 1970 to 2037')
        return {'not_before': moment}
    place, colon, metres = value.partition(':')
    try:
        distance = float(metres) if colon else _NEAR
    except ValueError:
        distance = math.nan
    if not (place and 0.0 < distance < _FARTHEST):
        raise UsageError(f'{short_repr(value)}: expected PLACE or PLACE:METRES, less than {_FARTHEST:g} m')
    return {'place': place, 'distance': distance}


_NONE: Final[dict[str, dict[str, Any]]] = {
    'battery': {'battery': -1.0},
    'time': {'window': ''},
    'after': {'not_before': 0.0},
    'near': {'place': '', 'distance': 0.0},
}


def conditions(typed: Typed) -> Iterable[str]:
    """Return the beginnings of conditions, and the places of the robot."""
    places = (f'near={place}' for place in sorted(typed.view.places))
    return (*CONDITIONS, *places) if typed.view.snapshot is not None else ()


def _moment(text: str) -> float:
    for form in ('%Y-%m-%dT%H:%M', '%Y-%m-%dT%H:%M:%S'):
        try:
            return time.mktime(time.strptime(text, form))
        except (ValueError, OverflowError):
            continue
    raise UsageError(f'{short_repr(text)}: expected +DURATION, or a time of this computer as in 2026-01-31T08:00')


def _options(line: CommandLine, view: View, options: QueueOptions) -> QueueOptions:
    """Return the options with those of the line."""
    changes: dict[str, Any] = {}
    now = view.snapshot.stamp if view.snapshot is not None else 0.0
    for name, value in map(condition, line.values('--when')):
        changes.update(_NONE[name] if value == NO_CONDITION else _changes(name, value, now))
    for option, changed in _CHANGED.items():
        for text in line.values(option):
            changes.update(changed(text))
    return replace(options, **changes, wanted=tuple(line.values('--wanted')) or options.wanted)


_CHANGED: Final[Mapping[str, Callable[[str], dict[str, Any]]]] = {
    '--priority': lambda text: {'priority': priority(text)},
    '--every': lambda text: {'interval': duration(text), 'count': 0},
    '--repeat': lambda text: {'count': run_count(text)},
    '--on-failure': lambda text: dict(zip(('on_failure', 'retries'), on_failure(text), strict=True)),
}
"""The fields that an option sets. The order counts: --repeat limits --every."""


def show(line: CommandLine, view: View, mirror: Mirror) -> Reading:
    queue = queue_of(view)
    return Reading(queue, queue_lines(queue, view.places))


def queue_of(view: View) -> MissionQueue:
    """Return the queue. Raises NoAnswerError if it has not arrived."""
    if view.queue is None:
        raise NoAnswerError('the executive has not sent its mission queue')
    return view.queue


def _entry(view: View, line: CommandLine) -> QueueEntry:
    queue, number = queue_of(view), item_number(line.first_word)
    found = queue.entry(number)
    if found is None:
        known = ', '.join(str(entry.number) for entry in queue.entries) or 'none'
        raise RefusedError(f'the queue has no entry {number}; its entries: {known}')
    return found


def _add(line: CommandLine, view: View, builder: CommandBuilder) -> OperatorCommand:
    options = _options(line, view, QueueOptions())
    return replace(start(line, view, builder), kind=CommandKind.QUEUE_ADD, queue_options=(options,))


def _edit(line: CommandLine, view: View) -> dict[str, Any]:
    entry = _entry(view, line)
    arguments = tuple(assignment(word) for word in line.words[1:])
    check_behavior(view, entry.behavior, arguments, unseen=True)
    level = autonomy_level(line.value('--autonomy')) if line.has('--autonomy') else entry.autonomy
    return {
        'queue_number': entry.number,
        'queue_revision': entry.revision,
        'arguments': arguments,
        'inputs': tuple(start_input(text, view.places) for text in line.values('--input')),
        'autonomy': int(level),
        'queue_options': (_options(line, view, entry.options),),
    }


def _move(line: CommandLine, view: View) -> dict[str, Any]:
    entry, where = _entry(view, line), line.words[1]
    peers = [one.number for one in queue_of(view).entries if one.options.priority == entry.options.priority]
    before = {'first': peers[0], 'last': 0}.get(where) if where in WHERE else item_number(where)
    return {'queue_number': entry.number, 'queue_before': before}


def _release(line: CommandLine, view: View) -> dict[str, Any]:
    hold = item_number(line.value(HOLD_OPTION)) if line.has(HOLD_OPTION) else queue_of(view).hold
    if not hold:
        raise RefusedError('the queue is not held')
    return {'queue_number': hold}


def _clear(line: CommandLine, view: View) -> dict[str, Any]:
    newest = max((entry.number for entry in queue_of(view).entries), default=0)
    if not newest:
        raise RefusedError('the queue is empty')
    return {'queue_number': newest}


def _send(kind: CommandKind, fields: Callable[[CommandLine, View], dict[str, Any]]) -> Send:
    return Send((kind,), lambda line, view, builder: builder.command(view, kind, run_id='', **fields(line, view)))


ADD: Final = Send((CommandKind.QUEUE_ADD,), _add)
EDIT: Final = _send(CommandKind.QUEUE_EDIT, _edit)
MOVE: Final = _send(CommandKind.QUEUE_MOVE, _move)
REMOVE: Final = _send(CommandKind.QUEUE_REMOVE, lambda line, view: {'queue_number': _entry(view, line).number})
HOLD: Final = _send(CommandKind.QUEUE_HOLD, lambda line, view: {})
RELEASE: Final = _send(CommandKind.QUEUE_RELEASE, _release)
CLEAR: Final = _send(CommandKind.QUEUE_CLEAR, _clear)
