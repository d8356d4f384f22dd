# SPDX-License-Identifier: BSD-3-Clause
"""The journal of an executive's runs: the records of a run, and reading them after a crash.

A run that an operator has started resumes after a crash if an operator requests it. A run that a program has started
does not resume, since the program no longer waits for its result.
"""

from __future__ import annotations

import base64
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from rclpy.serialization import serialize_message

from flexbt_common.values.limits import deserialize
from flexbt_common.values.value_types import message_type_name, resolve_type
from flexbt_core.clock.clock import Clock
from flexbt_core.errors import FlexbtError
from flexbt_core.state_machine.engine.events import CommandDecided
from flexbt_core.state_machine.engine.resume import RunPosition
from flexbt_core.state_machine.model.definition import PREEMPTED, ROOT_PATH
from flexbt_core.state_machine.model.userdata import StateMachineError
from flexbt_core.values.text import sanitize_for_message, short_repr
from flexbt_msgs.msg import BlackboardEntry, CommandResult
from flexbt_onboard.behaviors.run_building import RunRequest
from flexbt_onboard.errors import CommandRefusedError

from .journal import STUCK_SECONDS, Journal, JournaledResult
from .queue_entries import Change

REASON_LENGTH: Final = 2000
"""Maximum characters of the reason of a refusal. A longer reason is truncated in the middle."""


@dataclass(frozen=True)
class InterruptedRun:
    """A run that the end of the executive interrupted, with the data in the journal."""

    run_id: str
    behavior: str
    arguments: Sequence[tuple[str, str]]
    inputs: Sequence[BlackboardEntry]
    by: str
    autonomy: int
    active: Sequence[str]
    """Paths of the states that were active, or were going to be entered."""
    is_paused: bool
    levels: Mapping[str, int]
    locked: Sequence[str]
    breakpoints: Sequence[str]
    plain_position: Any
    queue_entry: int = 0
    """Number of the entry of the mission queue that it runs; 0 for none."""

    def position(self) -> RunPosition | None:
        """Return the position from which the run resumes; None for its beginning.

        Raises:
            CommandRefusedError: a value in the journal cannot be read again.
        """
        if self.plain_position is None:
            return None
        try:
            return RunPosition.from_plain(from_plain_form(self.plain_position))
        except (FlexbtError, StateMachineError) as error:
            raise CommandRefusedError(
                f'run {self.run_id} cannot continue where it was: {error}; abort it, and start the behavior anew'
            ) from error


class RunJournal(Journal):
    """The journal of an executive's runs. From any thread."""

    def __init__(self, file: Path | None, on_problem: Callable[[str], None], clock: Clock) -> None:
        """Open the journal; see :class:`Journal`."""
        super().__init__(file, on_problem, clock)
        self._lost: set[str] = set()

    @property
    def results(self) -> Sequence[CommandResult]:
        """Results of commands that were decided before the restart, oldest first."""
        return [
            CommandResult(
                command_id=command_id, code=code, reason=sanitize_for_message(reason)
            )  # its length was limited when it was written
            for command_id, (code, reason) in self.state.commands.items()
        ]

    @property
    def interrupted(self) -> InterruptedRun | None:
        """Run that has begun and not ended; None if no run has. Read it only while no run is active."""
        begin, position = self.state.begin, self.state.position or {}
        if begin is None:
            return None
        paths: list[str] = [*position.get('active', ()), *position.get('coming', ())]
        around = {path[:place] for path in paths for place, sign in enumerate(path) if sign == '/'}
        levels = position.get('levels', {})
        return InterruptedRun(
            run_id=begin['run'],
            behavior=begin['behavior'],
            arguments=[(name, value) for name, value in begin['arguments']],
            inputs=[
                BlackboardEntry(key=key, type=type, text=text, data=base64.b64decode(data))
                for key, type, text, data in begin['inputs']
            ],
            by=begin['by'],
            autonomy=levels.get(ROOT_PATH, begin['autonomy']),
            active=[path for path in paths if path not in around],
            is_paused=bool(position.get('is_paused')),
            levels=levels,
            locked=position.get('locked', []),
            breakpoints=position.get('breakpoints', []),
            plain_position=self.state.position,
            queue_entry=begin.get('entry', 0),
        )

    def begin(self, run_id: str, request: RunRequest) -> None:
        """Write that a run begins or resumes, and that the command that requested it was applied."""
        if request.is_durable:
            applied = _results([CommandDecided(request.command_id, None)])
            self.append(applied, **({'begin': _begin(run_id, request)} if request.at is None else {}))
            if request.queue_entry:
                self.sync(2.0 * STUCK_SECONDS)  # else a crash now would leave the entry in the queue, and it ran twice

    def has(self, run_id: str) -> bool:
        """Return whether the journal records a run: the run is durable and has not ended."""
        begin = self.state.begin
        return begin is not None and begin['run'] == run_id

    def move(
        self,
        run_id: str,
        position: RunPosition,
        decided: Sequence[CommandDecided],
        switched_to: RunRequest | None = None,
    ) -> Sequence[str]:
        """Write the position of a run that the journal has, and the decided commands, in one line.

        Return the types of values that cannot be written, each type only once per journal.
        """
        lost: set[str] = set()
        line: dict[str, Any] = {'run': run_id, 'position': to_plain_form(position.to_plain(), lost.add)}
        if switched_to is not None:
            line['begin'] = _begin(run_id, switched_to)
        self.append(_results(decided), **line)
        new = sorted(lost - self._lost)
        self._lost |= lost
        return new

    def decide(self, command_id: str, reason: str | None) -> None:
        """Write that a command was decided, unless the journal has that already."""
        if command_id not in self.state.commands:
            self.append([_result(command_id, reason)])

    def end(
        self, run_id: str, why: str, outcome: str = PREEMPTED, message: str = '', *, is_forced: bool = False
    ) -> None:
        """Write that a run has ended, or will not resume; in the same line for the entry of the queue that it runs."""
        begin = self.state.begin
        if begin is not None and self.has(run_id):
            entry = begin.get('entry', 0)
            told = sanitize_for_message(message or why, REASON_LENGTH)
            ended: dict[str, Any] = {'queue': {'ended': [entry, outcome, told, is_forced]}} if entry else {}
            self.append(run=run_id, end=why, **ended)

    def change_queue(self, change: Change, command_id: str | None = None) -> None:
        """Write a change of the mission queue, and that the command that requested it was applied, in one line."""
        self.append(_results([CommandDecided(command_id, None)]), queue=change)

    @property
    def next_autonomy(self) -> int | None:
        """Autonomy level for the next run that an operator set before a crash; None if no operator did."""
        return self.state.autonomy

    def set_next_autonomy(self, level: int | None) -> None:
        """Write the autonomy level for the next run; None when the executive ends normally, which drops the level."""
        if level != self.state.autonomy:
            self.append(autonomy=level)


def _begin(run_id: str, request: RunRequest) -> dict[str, Any]:
    return {
        'run': run_id,
        'behavior': request.entry.name,
        'arguments': [list(argument) for argument in request.arguments],
        'inputs': [
            [entry.key, entry.type, entry.text, base64.b64encode(bytes(entry.data)).decode()]
            for entry in request.inputs
        ],
        'by': request.by,
        'autonomy': request.autonomy,
        **({'entry': request.queue_entry} if request.queue_entry else {}),
    }


def _results(decided: Sequence[CommandDecided]) -> list[JournaledResult]:
    """Return the results of commands of operators. The ids of other commands are not strings."""
    return [_result(one.command_id, one.refusal) for one in decided if isinstance(one.command_id, str)]


def _result(command_id: str, reason: str | None) -> JournaledResult:
    code = CommandResult.APPLIED if reason is None else CommandResult.REFUSED
    return command_id, code, sanitize_for_message(reason or '', REASON_LENGTH)


# Lossless conversion of userdata to JSON and back: numbers, strings, bytes, containers of these, and ROS messages.
#
# Reading imports and calls nothing except installed message types. For a value of another type, only the name of the
# type is written, and reading it raises an error with that name.

_MARK: Final = '$'
"""Prefix of the only key of an object that represents something other than a mapping with string keys."""

_MOST_DEPTH: Final = 64

_MOST_BITS: Final = 8192
"""Maximum bits of an integer. Python refuses to convert integers of more than 4300 digits."""


def _ignore(_what: str) -> None:
    """Ignore a lost value."""


def to_plain_form(value: Any, on_lost: Callable[[str], object] = _ignore, depth: int = 0) -> Any:
    """Convert a value to a form that ``json.dumps`` accepts. Never raise.

    If a value cannot be converted, the result has the name of its type, and ``on_lost`` is called with it.
    """
    if value is None or type(value) in (bool, float, str):
        return value
    if type(value) is int:
        return value if value.bit_length() <= _MOST_BITS else _lost(value, on_lost)
    if depth > _MOST_DEPTH:
        return _lost(value, on_lost)
    if type(value) is list:
        return [to_plain_form(item, on_lost, depth + 1) for item in value]
    if type(value) is tuple:
        return {'$tuple': [to_plain_form(item, on_lost, depth + 1) for item in value]}
    if type(value) is dict:
        if all(type(key) is str and not key.startswith(_MARK) for key in value):
            return {key: to_plain_form(item, on_lost, depth + 1) for key, item in value.items()}
        return {'$map': [[to_plain_form(part, on_lost, depth + 1) for part in item] for item in value.items()]}
    if type(value) is bytes:
        return {'$bytes': base64.b64encode(value).decode()}
    if hasattr(type(value), 'get_fields_and_field_types'):
        try:
            data = base64.b64encode(bytes(serialize_message(value))).decode()
            return {'$message': [message_type_name(type(value)), data]}
        except Exception:  # the middleware may raise anything for fields of wrong types
            return _lost(value, on_lost)
    return _lost(value, on_lost)


def from_plain_form(value: Any, depth: int = 0) -> Any:
    """Convert the form of :func:`to_plain_form` back to the value.

    Raises:
        FlexbtError: the value could not be written, or is not in this form.
    """
    if depth > _MOST_DEPTH + 1:
        raise FlexbtError(f'{short_repr(value)} is not a value that was written here: it is in {depth} others')

    def inner(item: Any) -> Any:
        return from_plain_form(item, depth + 1)

    if isinstance(value, list):
        return [inner(item) for item in value]
    if not isinstance(value, dict):
        return value
    mark = next(iter(value), '')
    if len(value) != 1 or not mark.startswith(_MARK):
        return {key: inner(item) for key, item in value.items()}
    content = value[mark]
    try:
        if mark == '$tuple':
            return tuple(inner(item) for item in content)
        if mark == '$map':
            return {inner(key): inner(item) for key, item in content}
        if mark == '$bytes':
            return base64.b64decode(content, validate=True)
        if mark == '$message':
            name, data = content
            return deserialize(base64.b64decode(data, validate=True), resolve_type(name).message)
    except FlexbtError:
        raise
    except Exception as error:
        raise FlexbtError(f'{short_repr(value)} is not a value that was written here: {error}') from error
    if mark == '$lost':
        raise FlexbtError(f'a value of type {content} could not be written')
    raise FlexbtError(f'{short_repr(value)} is not a value that was written here')


def _lost(value: Any, on_lost: Callable[[str], object]) -> dict[str, str]:
    name = f'{type(value).__module__}.{type(value).__qualname__}'
    on_lost(name)
    return {'$lost': name}
