# SPDX-License-Identifier: BSD-3-Clause
"""What each command of an operator does, and when it is refused (flexbt_msgs/msg/ExecutiveCommand)."""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any, Final

from flexbt_core.state_machine import Answer, MachineRun
from flexbt_msgs.msg import BlackboardEntry, ExecutiveCommand
from flexbt_onboard.behaviors import BehaviorLibrary, RunRequest
from flexbt_onboard.durability.run_journal import InterruptedRun
from flexbt_onboard.errors import BehaviorError, CommandRefusedError
from flexbt_onboard.runs.behavior_run import BehaviorRun, RunPhase

if TYPE_CHECKING:
    from flexbt_onboard.node.executive import Executive

_HIGHEST_AUTONOMY: Final = 3
_APPLIED: Final = True
_ANSWERED_LATER: Final = False

_FREE_TO_ALL: Final = frozenset(
    (
        ExecutiveCommand.STOP,  # whoever sees that something goes wrong has to be able to stop it
        ExecutiveCommand.CLAIM_AUTHORITY,
        ExecutiveCommand.RELEASE_AUTHORITY,
        ExecutiveCommand.HAND_OVER_AUTHORITY,
    )
)
"""Commands that need no authority, or look after it by themselves."""

KINDS: Final = {
    getattr(ExecutiveCommand, name): name
    for name in (
        *('START', 'STOP', 'AUTONOMY', 'CONFIRM', 'FORCE', 'ANSWER', 'DECLINE', 'PAUSE', 'RESUME', 'REPEAT', 'LOCK'),
        *('UNLOCK', 'SWITCH', 'BREAKPOINT', 'CLEAR_BREAKPOINT', 'CLAIM_AUTHORITY', 'RELEASE_AUTHORITY'),
        *('HAND_OVER_AUTHORITY', 'RESUME_RUN', 'ABORT_RUN'),
    )
}
"""Names of the commands."""


class CommandHandlers:
    """Applies commands that were not seen before. On the executor thread."""

    def __init__(self, executive: Executive) -> None:
        self._executive = executive
        self._handlers: dict[int, Callable[[ExecutiveCommand], bool]] = {
            ExecutiveCommand.START: self._start,
            ExecutiveCommand.STOP: self._stop,
            ExecutiveCommand.AUTONOMY: self._autonomy,
            ExecutiveCommand.CONFIRM: self._confirm,
            ExecutiveCommand.FORCE: self._force,
            ExecutiveCommand.ANSWER: self._answer,
            ExecutiveCommand.DECLINE: self._decline,
            ExecutiveCommand.PAUSE: self._pause,
            ExecutiveCommand.RESUME: self._resume,
            ExecutiveCommand.REPEAT: functools.partial(self._at_path, MachineRun.repeat),
            ExecutiveCommand.LOCK: functools.partial(self._at_path, MachineRun.lock),
            ExecutiveCommand.UNLOCK: functools.partial(self._at_path, MachineRun.unlock),
            ExecutiveCommand.BREAKPOINT: functools.partial(self._at_path, MachineRun.set_breakpoint),
            ExecutiveCommand.CLEAR_BREAKPOINT: functools.partial(self._at_path, MachineRun.clear_breakpoint),
            ExecutiveCommand.SWITCH: self._switch,
            ExecutiveCommand.RESUME_RUN: self._resume_run,
            ExecutiveCommand.ABORT_RUN: self._abort_run,
            ExecutiveCommand.CLAIM_AUTHORITY: self._claim_authority,
            ExecutiveCommand.RELEASE_AUTHORITY: self._release_authority,
            ExecutiveCommand.HAND_OVER_AUTHORITY: self._hand_over_authority,
        }

    def handle(self, command: ExecutiveCommand) -> bool:
        """Apply a command; True when it has had its effect, False when it is answered later.

        Raises:
            CommandRefusedError: it has no effect; the text is the reason.
        """
        handler = self._handlers.get(command.kind)
        if handler is None:
            raise CommandRefusedError(f'{kind_name(command)} is not supported by this version')
        if command.kind not in _FREE_TO_ALL:
            self._executive.authority.check(command.operator_id)
        return handler(command)

    def _start(self, command: ExecutiveCommand) -> bool:
        request = run_request(
            self._executive.library,
            command.behavior,
            [(argument.name, argument.value) for argument in command.arguments],
            command.inputs,
            command.autonomy,
            command.operator_id,
        )
        self._executive.start(request, self._executive.answer_of(command))
        return _ANSWERED_LATER

    def _stop(self, command: ExecutiveCommand) -> bool:
        by = f'operator {command.operator_id}' if command.operator_id else 'the operator'
        self._run_of(command).stop(f'stopped by {by}' + (f': {command.reason}' if command.reason else ''))
        return _APPLIED

    def _autonomy(self, command: ExecutiveCommand) -> bool:
        level = _checked_autonomy(command.autonomy)
        executive = self._executive
        if executive.run is None:
            if command.path:
                raise CommandRefusedError(f'no behavior is running, so there is no state {command.path!r}')
            executive.autonomy = level
            return _APPLIED
        run = self._run_of(command)
        run.set_autonomy(level, command.path, self._executive.answer_of(command))
        return _ANSWERED_LATER

    def _confirm(self, command: ExecutiveCommand) -> bool:
        if not command.decision_id:
            raise CommandRefusedError('CONFIRM must name the decision that it answers in decision_id')
        run = self._running(command)
        if self._executive.questions.is_open(command.decision_id):
            raise CommandRefusedError(f'decision {command.decision_id!r} asks for a value: answer it, or decline')
        run.confirm(command.decision_id, self._executive.answer_of(command))
        return _ANSWERED_LATER

    def _force(self, command: ExecutiveCommand) -> bool:
        if not command.path or not command.outcome:
            raise CommandRefusedError('FORCE must name path and outcome')
        run = self._running(command)
        run.force(command.path, command.outcome, command.decision_id, self._executive.answer_of(command))
        return _ANSWERED_LATER

    def _answer(self, command: ExecutiveCommand) -> bool:
        self._refuse_other_run(command)
        if len(command.inputs) != 1:
            raise CommandRefusedError(f'ANSWER must carry one value in inputs, not {len(command.inputs)}')
        self._executive.questions.answer(command.decision_id, command.inputs[0], command.operator_id)
        return _APPLIED

    def _decline(self, command: ExecutiveCommand) -> bool:
        self._refuse_other_run(command)
        self._executive.questions.decline(command.decision_id, command.operator_id, command.reason)
        return _APPLIED

    def _resume_run(self, command: ExecutiveCommand) -> bool:
        interrupted = self._interrupted(command)
        request = run_request(
            self._executive.library,
            interrupted.behavior,
            interrupted.arguments,
            interrupted.inputs,
            interrupted.autonomy,
            command.operator_id,
        )
        request = dataclasses.replace(request, at=interrupted.position())
        self._executive.start(request, self._executive.answer_of(command), run_id=interrupted.run_id)
        return _ANSWERED_LATER

    def _abort_run(self, command: ExecutiveCommand) -> bool:
        by = f'operator {command.operator_id}' if command.operator_id else 'the operator'
        self._executive.give_up(self._interrupted(command), f'interrupted, and given up by {by}')
        return _APPLIED

    def _interrupted(self, command: ExecutiveCommand) -> InterruptedRun:
        interrupted = self._executive.interrupted
        if interrupted is None:
            raise CommandRefusedError('no run was interrupted')
        if interrupted.run_id != command.run_id:
            raise CommandRefusedError(
                f'meant for run {command.run_id or "none"}, but run {interrupted.run_id} was interrupted'
            )
        return interrupted

    def _claim_authority(self, command: ExecutiveCommand) -> bool:
        self._executive.authority.claim(command.operator_id)
        return _APPLIED

    def _release_authority(self, command: ExecutiveCommand) -> bool:
        self._executive.authority.release(command.operator_id)
        return _APPLIED

    def _hand_over_authority(self, command: ExecutiveCommand) -> bool:
        self._executive.authority.hand_over(command.operator_id, command.grantee)
        return _APPLIED

    def _pause(self, command: ExecutiveCommand) -> bool:
        self._running(command).command(MachineRun.pause, self._executive.answer_of(command))
        return _ANSWERED_LATER

    def _resume(self, command: ExecutiveCommand) -> bool:
        self._running(command).command(MachineRun.resume, self._executive.answer_of(command))
        return _ANSWERED_LATER

    def _at_path(self, apply: Callable[[MachineRun, str, Answer], None], command: ExecutiveCommand) -> bool:
        if not command.path:
            raise CommandRefusedError(f'{kind_name(command)} must name path')
        run = self._running(command)
        run.command(lambda machine, once: apply(machine, command.path, once), self._executive.answer_of(command))
        return _ANSWERED_LATER

    def _switch(self, command: ExecutiveCommand) -> bool:
        run = self._running(command)
        request = run_request(
            self._executive.library,
            command.behavior,
            [(argument.name, argument.value) for argument in command.arguments],
            (),
            run.request.autonomy,
            command.operator_id,
            is_durable=run.request.is_durable,
        )
        run.switch(request, self._executive.answer_of(command))
        return _ANSWERED_LATER

    def _run_of(self, command: ExecutiveCommand) -> BehaviorRun:
        """The run that the command is meant for, when it is the one that goes on."""
        run = self._executive.run
        if run is None:
            meant = f'; run {command.run_id} is not active' if command.run_id else ''
            raise CommandRefusedError(f'no behavior is running{meant}')
        if not command.run_id:
            raise CommandRefusedError('the command must name the run that it is meant for in run_id')
        if run.run_id != command.run_id:
            raise CommandRefusedError(f'meant for run {command.run_id}, but run {run.run_id} is active now')
        return run

    def _running(self, command: ExecutiveCommand) -> BehaviorRun:
        run = self._run_of(command)
        if run.phase not in (RunPhase.RUNNING, RunPhase.PAUSED):
            raise CommandRefusedError(f'behavior {run.behavior!r} is {run.phase.name.lower()}')
        return run

    def _refuse_other_run(self, command: ExecutiveCommand) -> None:
        # A question may also come from a node of its own, while no behavior runs: then the shown run counts.
        shown = self._executive.shown_run_id
        if command.run_id != shown:
            raise CommandRefusedError(
                f'meant for run {command.run_id or "none"}, but run {shown or "none"} is shown now'
            )


def run_request(
    library: BehaviorLibrary,
    behavior: str,
    arguments: Sequence[tuple[str, str]],
    inputs: Sequence[BlackboardEntry],
    autonomy: int,
    by: str,
    *,
    is_durable: bool = True,
) -> RunRequest:
    """What to run, from what somebody asks for.

    Raises:
        CommandRefusedError: there is no such behavior, it is broken, or the level of autonomy is none.
    """
    try:
        entry = library.find(behavior)
    except BehaviorError as error:
        raise CommandRefusedError(str(error)) from error
    if entry.error:
        raise CommandRefusedError(f'behavior {entry.name!r} is broken: {entry.error}')
    return RunRequest(entry, tuple(arguments), tuple(inputs), _checked_autonomy(autonomy), by, is_durable=is_durable)


def kind_name(command: ExecutiveCommand) -> str:
    """What a command is called."""
    return KINDS.get(command.kind, f'kind {command.kind}')


def command_fields(command: ExecutiveCommand) -> dict[str, Any]:
    """The fields of a command that are set, for the record."""
    fields: dict[str, Any] = {
        'id': command.id,
        'command': kind_name(command),
        'operator': command.operator_id,
        'given': round(command.stamp.sec + command.stamp.nanosec * 1e-9, 6),
        'executive': command.executive_id,
        'run': command.run_id,
        'decision': command.decision_id,
        'path': command.path,
        'outcome': command.outcome,
        'behavior': command.behavior,
        'arguments': {argument.name: argument.value for argument in command.arguments},
        'inputs': {entry.key: f'{entry.type}: {entry.text or "..."}' for entry in command.inputs},
        'grantee': command.grantee,
        'because': command.reason,
    }
    if command.kind in (ExecutiveCommand.START, ExecutiveCommand.AUTONOMY):
        fields['autonomy'] = int(command.autonomy)
    return {name: value for name, value in fields.items() if value != '' and value != {}}


def _checked_autonomy(level: int) -> int:
    if level > _HIGHEST_AUTONOMY:
        raise CommandRefusedError(f'autonomy {level} is none of 0 Off, 1 Low, 2 High, 3 Full')
    return level
