# SPDX-License-Identifier: BSD-3-Clause
"""The commands of an operator: what each needs, and what is refused for the lack of it.

A new command is a constant and its fields in flexbt_msgs/msg/ExecutiveCommand, and an entry in
:data:`flexbt_onboard.commands.command_handlers.COMMANDS`.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from enum import Enum
from typing import Any, Final

from flexbt_common.values import seconds_of
from flexbt_core.state_machine import Answer
from flexbt_core.values import excerpt
from flexbt_msgs.msg import ExecutiveCommand
from flexbt_onboard.behaviors import BehaviorLibrary
from flexbt_onboard.durability import InterruptedRun
from flexbt_onboard.errors import CommandRefusedError
from flexbt_onboard.event_log import Reporter
from flexbt_onboard.runs import BehaviorRun, RunPhase, RunSupervisor

from .authority import Authority
from .input_requests import InputRequests
from .operator_names import OperatorNames

LOGGED: Final = 1000
"""Characters of a value of a command that are in the event log."""


class NeededRun(Enum):
    """Which run a command has to name in ``run_id``."""

    NONE = 'none'
    ANY = 'the run that goes on; none while idle'
    RUNNING = 'the run that goes on, when it is running or paused'
    SHOWN = 'the run that the status shows, also when it has ended'
    INTERRUPTED = 'the run that was interrupted'


@dataclass(frozen=True)
class Given:
    """A command, and what it acts on."""

    command: ExecutiveCommand
    library: BehaviorLibrary
    runs: RunSupervisor
    authority: Authority
    input_requests: InputRequests
    report: Reporter

    @property
    def run(self) -> BehaviorRun:
        """The run that goes on, which the command needs."""
        assert self.runs.run is not None
        return self.runs.run

    @property
    def interrupted(self) -> InterruptedRun:
        """The run that was interrupted, which the command needs."""
        assert self.runs.interrupted is not None
        return self.runs.interrupted


Effect = Callable[[Answer], object]
"""Brings a command's effect about, and gives the answer when it can be seen, or why there is none."""


@dataclass(frozen=True)
class Command:
    """A command by the name of its constant in ExecutiveCommand.

    ``apply`` has the effect of a command that needs nothing more, or gives the :class:`Effect` that takes longer; it
    raises CommandRefusedError. ``fields`` must not be empty. One that is ``for_anybody`` asks neither whose the
    operator's name is, nor which executive was meant.
    """

    name: str
    apply: Callable[[Given], Effect | None]
    run: NeededRun = NeededRun.RUNNING
    fields: Sequence[str] = ()
    needs_authority: bool = True
    for_anybody: bool = False

    @property
    def kind(self) -> int:
        """The constant."""
        return int(getattr(ExecutiveCommand, self.name))


class CommandRegistry:
    """Applies commands. Used on the executor thread only; see :class:`~.command_ledger.CommandHandling`."""

    def __init__(
        self,
        commands: Sequence[Command],
        executive_id: str,
        library: BehaviorLibrary,
        runs: RunSupervisor,
        names: OperatorNames,
        authority: Authority,
        input_requests: InputRequests,
        report: Reporter,
    ) -> None:
        self._commands: Mapping[int, Command] = {command.kind: command for command in commands}
        self._executive_id = executive_id
        self._library = library
        self._runs = runs
        self._names = names
        self._authority = authority
        self._input_requests = input_requests
        self._report = report

    def is_addressed(self, command: ExecutiveCommand) -> bool:
        """Whether a command is for this executive, which cannot know what another one made of it."""
        if command.executive_id in ('', self._executive_id):
            return True
        known = self._commands.get(command.kind)
        return known is not None and known.for_anybody

    def fields(self, command: ExecutiveCommand) -> dict[str, Any]:
        """What the command says, for the event log."""
        known = self._commands.get(command.kind)
        return command_fields(command, known.name if known is not None else f'kind {command.kind}')

    def apply(self, command: ExecutiveCommand, answer: Answer, writer: bytes) -> bool:
        """True when it has had its effect; False when ``answer`` gets to know about it later, on any thread.

        Raises:
            CommandRefusedError: it has no effect; the text is the reason.
        """
        known = self._commands.get(command.kind)
        if known is None:
            raise CommandRefusedError(f'kind {command.kind} is not supported by this version')
        if not known.for_anybody:
            self._names.check(command.operator_id, writer)
        if known.needs_authority:
            self._authority.check(command.operator_id)
        if missing := [name for name in known.fields if not getattr(command, name)]:
            raise CommandRefusedError(f'{known.name} must name {" and ".join(missing)}')
        _CHECKS[known.run](self._runs, command)
        given = Given(command, self._library, self._runs, self._authority, self._input_requests, self._report)
        effect = known.apply(given)
        if effect is not None:
            effect(answer)
        return effect is None


def _check_none(_runs: RunSupervisor, _command: ExecutiveCommand) -> None:
    """It needs no run."""


def _check_any(runs: RunSupervisor, command: ExecutiveCommand) -> None:
    interrupted = runs.interrupted
    if interrupted is not None:
        raise CommandRefusedError(
            f'behavior {interrupted.behavior!r} was interrupted (run {interrupted.run_id}); resume or abort it first'
        )
    if runs.run is not None or command.run_id:
        _check_going_on(runs, command)


def _check_going_on(runs: RunSupervisor, command: ExecutiveCommand) -> None:
    run = runs.snapshot
    if run is None:
        meant = f'; run {command.run_id} is not active' if command.run_id else ''
        raise CommandRefusedError(f'no behavior is running{meant}')
    if not command.run_id:
        raise CommandRefusedError('the command must name the run that it is meant for in run_id')
    if run.run_id != command.run_id:
        raise CommandRefusedError(f'meant for run {command.run_id}, but run {run.run_id} is active now')


def _check_running(runs: RunSupervisor, command: ExecutiveCommand) -> None:
    _check_going_on(runs, command)
    run = runs.snapshot
    if run is not None and run.phase not in (RunPhase.RUNNING, RunPhase.PAUSED):
        raise CommandRefusedError(f'behavior {run.behavior!r} is {run.phase.value}')


def _check_shown(runs: RunSupervisor, command: ExecutiveCommand) -> None:
    shown = runs.shown.run_id
    if command.run_id != shown:
        raise CommandRefusedError(f'meant for run {command.run_id or "none"}, but run {shown or "none"} is shown now')


def _check_interrupted(runs: RunSupervisor, command: ExecutiveCommand) -> None:
    interrupted = runs.interrupted
    if interrupted is None:
        raise CommandRefusedError('no run was interrupted')
    if interrupted.run_id != command.run_id:
        raise CommandRefusedError(
            f'meant for run {command.run_id or "none"}, but run {interrupted.run_id} was interrupted'
        )


_CHECKS: Final[Mapping[NeededRun, Callable[[RunSupervisor, ExecutiveCommand], None]]] = {
    NeededRun.NONE: _check_none,
    NeededRun.ANY: _check_any,
    NeededRun.RUNNING: _check_running,
    NeededRun.SHOWN: _check_shown,
    NeededRun.INTERRUPTED: _check_interrupted,
}


def command_fields(command: ExecutiveCommand, name: str) -> dict[str, Any]:
    """The fields of a command that are set, for the event log; of long values only what shows which they were."""
    fields: dict[str, Any] = {
        'id': command.id,
        'command': name,
        'operator': command.operator_id,
        'given': round(seconds_of(command.stamp), 6),
        'executive': command.executive_id,
        'run': command.run_id,
        'decision': command.decision_id,
        'path': command.path,
        'outcome': command.outcome,
        'behavior': command.behavior,
        'arguments': {argument.name: excerpt(argument.value, LOGGED) for argument in command.arguments},
        'inputs': {entry.key: f'{entry.type}: {excerpt(entry.text, LOGGED) or "..."}' for entry in command.inputs},
        'grantee': command.grantee,
        'text': command.text,
        'because': command.reason,
    }
    if command.kind in (ExecutiveCommand.START, ExecutiveCommand.AUTONOMY):
        fields['autonomy'] = int(command.autonomy)
    for name in ('wait_queue', 'wait_interaction'):
        if 0.0 <= getattr(command, name) < math.inf:
            fields[name] = round(float(getattr(command, name)), 3)
    return {name: value for name, value in fields.items() if value != '' and value != {}}
