# SPDX-License-Identifier: BSD-3-Clause
"""The commands of an operator: what each requires, when it is refused, and what it does.

A new command is a constant and its fields in flexbt_msgs/msg/ExecutiveCommand, and an entry in
:data:`COMMANDS`.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from enum import Enum
from typing import Any, Final, Literal

from flexbt_common.values.message_fields import seconds_of
from flexbt_core.state_machine.engine import operator_commands
from flexbt_core.values.text import escape_lines, truncate_middle
from flexbt_msgs.msg import BlackboardEntry, ExecutiveCommand, ExecutiveLog
from flexbt_onboard.behaviors.behavior_library import BehaviorLibrary
from flexbt_onboard.behaviors.run_building import RunRequest, checked_autonomy, run_request
from flexbt_onboard.errors import CommandRefusedError
from flexbt_onboard.persistence.reporter import Reporter
from flexbt_onboard.persistence.run_journal import InterruptedRun
from flexbt_onboard.runs.behavior_run import BehaviorRun
from flexbt_onboard.runs.run_snapshot import RunPhase
from flexbt_onboard.runs.run_supervisor import RunSupervisor

from .authority import Authority, OperatorNames
from .input_requests import InputRequests

LOGGED: Final = 1000
"""Characters of a value of a command that are in the event log."""


class RunRequirement(Enum):
    """The run that a command has to name in ``run_id``."""

    NONE = 'none'
    ANY = 'the run that goes on; none while idle'
    RUNNING = 'the run that goes on, when it is running or paused'
    SHOWN = 'the run that the status shows, also when it has ended'
    INTERRUPTED = 'the run that was interrupted'


@dataclass(frozen=True)
class CommandContext:
    """A command, and what it acts on."""

    command: ExecutiveCommand
    library: BehaviorLibrary
    runs: RunSupervisor
    authority: Authority
    input_requests: InputRequests
    report: Reporter

    @property
    def run(self) -> BehaviorRun:
        """The current run, which the command needs."""
        assert self.runs.run is not None
        return self.runs.run

    @property
    def interrupted(self) -> InterruptedRun:
        """The run that was interrupted, which the command needs."""
        assert self.runs.interrupted is not None
        return self.runs.interrupted

    def to_machine(self, command: Callable[..., str | None], *arguments: Any) -> Later:
        """Give the machine of the run a command, which it applies between two steps."""
        self.run.command(self.command.id, command, *arguments)
        return 'later'


Later = Literal['later']
"""The effect of a command comes later: :class:`CommandDecided`, :class:`RunBuilt` or :class:`RunRefused` follows."""


@dataclass(frozen=True)
class CommandDefinition:
    """A command by the name of its constant in ExecutiveCommand.

    ``apply`` carries it out, at once or later; it raises CommandRefusedError. ``fields`` must not be empty. One that
    ``needs_no_operator`` asks neither whose the operator's name is, nor which executive was meant.
    """

    name: str
    apply: Callable[[CommandContext], Later | None]
    run: RunRequirement = RunRequirement.RUNNING
    fields: Sequence[str] = ()
    needs_authority: bool = True
    needs_no_operator: bool = False

    @property
    def kind(self) -> int:
        """The constant."""
        return int(getattr(ExecutiveCommand, self.name))


class CommandRegistry:
    """A registry that applies commands. Used on the executor thread only; see
    :class:`~.command_ledger.CommandHandling`."""

    def __init__(
        self,
        commands: Sequence[CommandDefinition],
        executive_id: str,
        library: BehaviorLibrary,
        runs: RunSupervisor,
        names: OperatorNames,
        authority: Authority,
        input_requests: InputRequests,
        report: Reporter,
    ) -> None:
        self._commands: Mapping[int, CommandDefinition] = {command.kind: command for command in commands}
        self._executive_id = executive_id
        self._library = library
        self._runs = runs
        self._names = names
        self._authority = authority
        self._input_requests = input_requests
        self._report = report

    def is_addressed(self, command: ExecutiveCommand) -> bool:
        """Return whether a command is for this executive, which cannot know what another one made of it."""
        if command.executive_id in ('', self._executive_id):
            return True
        known = self._commands.get(command.kind)
        return known is not None and known.needs_no_operator

    def fields(self, command: ExecutiveCommand) -> dict[str, Any]:
        """Return what the command says, for the event log."""
        known = self._commands.get(command.kind)
        return command_fields(command, known.name if known is not None else f'kind {command.kind}')

    def apply(self, command: ExecutiveCommand, writer: bytes) -> bool:
        """Return whether it has had its effect already.

        Raises:
            CommandRefusedError: it has no effect; the text is the reason.
        """
        known = self._commands.get(command.kind)
        if known is None:
            raise CommandRefusedError(f'kind {command.kind} is not supported by this version')
        if not known.needs_no_operator:
            self._names.check(command.operator_id, writer)
        if known.needs_authority:
            self._authority.check(command.operator_id)
        if missing := [name for name in known.fields if not getattr(command, name)]:
            raise CommandRefusedError(f'{known.name} must name {" and ".join(missing)}')
        _CHECKS[known.run](self._runs, command)
        given = CommandContext(command, self._library, self._runs, self._authority, self._input_requests, self._report)
        return known.apply(given) is None


def _check_none(_runs: RunSupervisor, _command: ExecutiveCommand) -> None:
    """Accept any run, or none."""


def _check_any(runs: RunSupervisor, command: ExecutiveCommand) -> None:
    interrupted = runs.interrupted
    if interrupted is not None:
        raise CommandRefusedError(
            f'behavior {interrupted.behavior!r} was interrupted (run {interrupted.run_id}); resume or abort it first'
        )
    if runs.run is not None or command.run_id:
        _check_active(runs, command)


def _check_active(runs: RunSupervisor, command: ExecutiveCommand) -> None:
    run = runs.snapshot
    if run is None:
        meant = f'; run {command.run_id} is not active' if command.run_id else ''
        raise CommandRefusedError(f'no behavior is running{meant}')
    if not command.run_id:
        raise CommandRefusedError('the command must name the run that it is meant for in run_id')
    if run.run_id != command.run_id:
        raise CommandRefusedError(f'meant for run {command.run_id}, but run {run.run_id} is active now')


def _check_running(runs: RunSupervisor, command: ExecutiveCommand) -> None:
    _check_active(runs, command)
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


_CHECKS: Final[Mapping[RunRequirement, Callable[[RunSupervisor, ExecutiveCommand], None]]] = {
    RunRequirement.NONE: _check_none,
    RunRequirement.ANY: _check_any,
    RunRequirement.RUNNING: _check_running,
    RunRequirement.SHOWN: _check_shown,
    RunRequirement.INTERRUPTED: _check_interrupted,
}


def command_fields(command: ExecutiveCommand, name: str) -> dict[str, Any]:
    """Return the fields of a command that are set, for the event log; of long values only what shows which they
    were."""
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
        'arguments': {argument.name: truncate_middle(argument.value, LOGGED) for argument in command.arguments},
        'inputs': {
            entry.key: f'{entry.type}: {truncate_middle(entry.text, LOGGED) or "..."}' for entry in command.inputs
        },
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


# The effect of each command of an operator (flexbt_msgs/msg/ExecutiveCommand).


def _start(given: CommandContext) -> Later:
    given.runs.start(_request(given, given.command.inputs, given.command.autonomy))
    return 'later'


def _switch(given: CommandContext) -> Later:
    given.run.switch(_request(given, (), given.run.snapshot.autonomy))
    return 'later'


def _request(given: CommandContext, inputs: Sequence[BlackboardEntry], autonomy: int) -> RunRequest:
    command = given.command
    arguments = [(argument.name, argument.value) for argument in command.arguments]
    by, command_id = command.operator_id, command.id
    return run_request(given.library, command.behavior, arguments, inputs, autonomy, by, command_id)


def _stop(given: CommandContext) -> None:
    reason = f'by {_operator(given)}' + (f': {given.command.reason}' if given.command.reason else '')
    run = given.runs.run
    if run is not None and given.command.run_id not in ('', run.snapshot.run_id):
        given.report.log(ExecutiveLog.WARN, f'{_operator(given)} stops what runs, and has seen another run')
    if run is None:
        given.report.log(ExecutiveLog.INFO, f'the robot is stopped {reason}')
    elif run.snapshot.is_stopping:
        run.abort(f'aborted {reason}')
    else:
        run.stop(f'stopped {reason}')
    given.runs.halt_robot()


def _autonomy(given: CommandContext) -> Later | None:
    level, path = checked_autonomy(given.command.autonomy), given.command.path
    if given.runs.run is not None:
        return given.to_machine(operator_commands.set_autonomy, level, path)
    if path:
        raise CommandRefusedError(f'no behavior is running, so there is no state {path!r}')
    given.runs.set_next_autonomy(level)
    return None


def _confirm(given: CommandContext) -> Later:
    decision = given.command.decision_id
    if given.input_requests.is_open(decision):
        raise CommandRefusedError(f'decision {decision!r} asks for a value: answer it, or decline')
    return given.to_machine(operator_commands.confirm, given.run.decision_number(decision))


def _force(given: CommandContext) -> Later:
    command = given.command
    number = given.run.decision_number(command.decision_id) if command.decision_id else ''
    return given.to_machine(operator_commands.force, command.path, command.outcome, number)


def _pause(given: CommandContext) -> Later:
    return given.to_machine(operator_commands.pause)


def _resume(given: CommandContext) -> Later:
    return given.to_machine(operator_commands.resume)


def _repeat(given: CommandContext) -> Later:
    return given.to_machine(operator_commands.repeat, given.command.path)


def _lock(given: CommandContext) -> Later:
    return given.to_machine(operator_commands.lock, given.command.path)


def _unlock(given: CommandContext) -> Later:
    return given.to_machine(operator_commands.unlock, given.command.path)


def _set_breakpoint(given: CommandContext) -> Later:
    return given.to_machine(operator_commands.set_breakpoint, given.command.path)


def _clear_breakpoint(given: CommandContext) -> Later:
    return given.to_machine(operator_commands.clear_breakpoint, given.command.path)


def _answer(given: CommandContext) -> None:
    command = given.command
    if len(command.inputs) != 1:
        raise CommandRefusedError(f'ANSWER must carry one value in inputs, not {len(command.inputs)}')
    given.input_requests.answer(command.decision_id, command.inputs[0], command.operator_id)


def _decline(given: CommandContext) -> None:
    command = given.command
    given.input_requests.decline(command.decision_id, command.operator_id, command.reason)


def _resume_run(given: CommandContext) -> Later:
    run = given.interrupted
    by, command_id = given.command.operator_id, given.command.id
    request = run_request(given.library, run.behavior, run.arguments, run.inputs, run.autonomy, by, command_id)
    given.runs.start(replace(request, at=run.position()), run.run_id)
    return 'later'


def _abort_run(given: CommandContext) -> None:
    given.runs.abort(given.interrupted, f'interrupted, and aborted by {_operator(given)}')


def _claim_authority(given: CommandContext) -> None:
    given.authority.claim(given.command.operator_id)


def _release_authority(given: CommandContext) -> None:
    given.authority.release(given.command.operator_id)


def _hand_over_authority(given: CommandContext) -> None:
    given.authority.hand_over(given.command.operator_id, given.command.grantee)


def _refuse_authority(given: CommandContext) -> None:
    given.authority.refuse(given.command.operator_id, given.command.grantee)


def _note(given: CommandContext) -> None:
    command = given.command
    given.report.note(command.operator_id, '\n'.join(escape_lines(command.text)), command.run_id)


def _operator(given: CommandContext) -> str:
    return f'operator {given.command.operator_id}' if given.command.operator_id else 'the operator'


COMMANDS: Final = (
    CommandDefinition('START', _start, RunRequirement.NONE),
    # Anyone who sees a fault has to be able to stop the run, whatever else they know of it.
    CommandDefinition('STOP', _stop, RunRequirement.NONE, needs_authority=False, needs_no_operator=True),
    CommandDefinition('AUTONOMY', _autonomy, RunRequirement.ANY),
    CommandDefinition('CONFIRM', _confirm, fields=['decision_id']),
    CommandDefinition('FORCE', _force, fields=['path', 'outcome']),
    CommandDefinition('ANSWER', _answer, RunRequirement.SHOWN),
    CommandDefinition('DECLINE', _decline, RunRequirement.SHOWN),
    CommandDefinition('PAUSE', _pause),
    CommandDefinition('RESUME', _resume),
    CommandDefinition('REPEAT', _repeat, fields=['path']),
    CommandDefinition('LOCK', _lock, fields=['path']),
    CommandDefinition('UNLOCK', _unlock, fields=['path']),
    CommandDefinition('SWITCH', _switch),
    CommandDefinition('BREAKPOINT', _set_breakpoint, fields=['path']),
    CommandDefinition('CLEAR_BREAKPOINT', _clear_breakpoint, fields=['path']),
    # Those of the authority look after it by themselves.
    CommandDefinition('CLAIM_AUTHORITY', _claim_authority, RunRequirement.NONE, needs_authority=False),
    CommandDefinition('RELEASE_AUTHORITY', _release_authority, RunRequirement.NONE, needs_authority=False),
    CommandDefinition(
        'HAND_OVER_AUTHORITY', _hand_over_authority, RunRequirement.NONE, fields=['grantee'], needs_authority=False
    ),
    CommandDefinition(
        'REFUSE_AUTHORITY', _refuse_authority, RunRequirement.NONE, fields=['grantee'], needs_authority=False
    ),
    CommandDefinition('RESUME_RUN', _resume_run, RunRequirement.INTERRUPTED),
    CommandDefinition('ABORT_RUN', _abort_run, RunRequirement.INTERRUPTED),
    CommandDefinition('NOTE', _note, RunRequirement.NONE, fields=['text'], needs_authority=False),
)
"""Every command that there is."""
