# SPDX-License-Identifier: BSD-3-Clause
"""What each command of an operator does (flexbt_msgs/msg/ExecutiveCommand)."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Final

from flexbt_core.state_machine import Answer, MachineRun
from flexbt_core.values import lines
from flexbt_msgs.msg import BlackboardEntry, ExecutiveLog
from flexbt_onboard.behaviors import RunRequest, checked_autonomy, run_request
from flexbt_onboard.errors import CommandRefusedError

from .command_registry import Command, Effect, Given, NeededRun


def _start(given: Given) -> Effect:
    request = _request(given, given.command.inputs, given.command.autonomy)
    return lambda answer: given.runs.start(request, answer)


def _switch(given: Given) -> Effect:
    request = _request(given, (), given.run.snapshot.autonomy)
    return lambda answer: given.run.switch(request, answer)


def _request(given: Given, inputs: Sequence[BlackboardEntry], autonomy: int) -> RunRequest:
    command = given.command
    arguments = [(argument.name, argument.value) for argument in command.arguments]
    return run_request(given.library, command.behavior, arguments, inputs, autonomy, command.operator_id)


def _stop(given: Given) -> None:
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


def _autonomy(given: Given) -> Effect | None:
    level, path = checked_autonomy(given.command.autonomy), given.command.path
    if given.runs.run is not None:
        return _to_machine(lambda machine, answer: machine.set_autonomy(level, path, answer))(given)
    if path:
        raise CommandRefusedError(f'no behavior is running, so there is no state {path!r}')
    given.runs.set_next_autonomy(level)
    return None


def _confirm(given: Given) -> Effect:
    decision = given.command.decision_id
    if given.input_requests.is_open(decision):
        raise CommandRefusedError(f'decision {decision!r} asks for a value: answer it, or decline')
    return lambda answer: given.run.confirm(decision, answer)


def _force(given: Given) -> Effect:
    command = given.command
    return lambda answer: given.run.force(command.path, command.outcome, command.decision_id, answer)


def _answer(given: Given) -> None:
    command = given.command
    if len(command.inputs) != 1:
        raise CommandRefusedError(f'ANSWER must carry one value in inputs, not {len(command.inputs)}')
    given.input_requests.answer(command.decision_id, command.inputs[0], command.operator_id)


def _decline(given: Given) -> None:
    command = given.command
    given.input_requests.decline(command.decision_id, command.operator_id, command.reason)


def _resume_run(given: Given) -> Effect:
    run = given.interrupted
    by = given.command.operator_id
    request = run_request(given.library, run.behavior, run.arguments, run.inputs, run.autonomy, by)
    request = replace(request, at=run.position())
    return lambda answer: given.runs.start(request, answer, run_id=run.run_id)


def _abort_run(given: Given) -> None:
    given.runs.abort(given.interrupted, f'interrupted, and aborted by {_operator(given)}')


def _claim_authority(given: Given) -> None:
    given.authority.claim(given.command.operator_id)


def _release_authority(given: Given) -> None:
    given.authority.release(given.command.operator_id)


def _hand_over_authority(given: Given) -> None:
    given.authority.hand_over(given.command.operator_id, given.command.grantee)


def _refuse_authority(given: Given) -> None:
    given.authority.refuse(given.command.operator_id, given.command.grantee)


def _note(given: Given) -> None:
    command = given.command
    given.report.note(command.operator_id, '\n'.join(lines(command.text)), command.run_id)


def _operator(given: Given) -> str:
    return f'operator {given.command.operator_id}' if given.command.operator_id else 'the operator'


def _to_machine(send: Callable[[MachineRun, Answer], None]) -> Callable[[Given], Effect]:
    """A command that the engine takes as it is."""
    return lambda given: lambda answer: given.run.command(send, answer)


def _at_path(send: Callable[[MachineRun, str, Answer], None]) -> Callable[[Given], Effect]:
    """A command that the engine takes for a state or container."""

    def apply(given: Given) -> Effect:
        path = given.command.path
        return _to_machine(lambda machine, answer: send(machine, path, answer))(given)

    return apply


COMMANDS: Final = (
    Command('START', _start, NeededRun.NONE),
    # Whoever sees that something goes wrong has to be able to stop it, whatever else they believe of the run.
    Command('STOP', _stop, NeededRun.NONE, needs_authority=False, for_anybody=True),
    Command('AUTONOMY', _autonomy, NeededRun.ANY),
    Command('CONFIRM', _confirm, fields=['decision_id']),
    Command('FORCE', _force, fields=['path', 'outcome']),
    Command('ANSWER', _answer, NeededRun.SHOWN),
    Command('DECLINE', _decline, NeededRun.SHOWN),
    Command('PAUSE', _to_machine(MachineRun.pause)),
    Command('RESUME', _to_machine(MachineRun.resume)),
    Command('REPEAT', _at_path(MachineRun.repeat), fields=['path']),
    Command('LOCK', _at_path(MachineRun.lock), fields=['path']),
    Command('UNLOCK', _at_path(MachineRun.unlock), fields=['path']),
    Command('SWITCH', _switch),
    Command('BREAKPOINT', _at_path(MachineRun.set_breakpoint), fields=['path']),
    Command('CLEAR_BREAKPOINT', _at_path(MachineRun.clear_breakpoint), fields=['path']),
    # Those of the authority look after it by themselves.
    Command('CLAIM_AUTHORITY', _claim_authority, NeededRun.NONE, needs_authority=False),
    Command('RELEASE_AUTHORITY', _release_authority, NeededRun.NONE, needs_authority=False),
    Command('HAND_OVER_AUTHORITY', _hand_over_authority, NeededRun.NONE, fields=['grantee'], needs_authority=False),
    Command('REFUSE_AUTHORITY', _refuse_authority, NeededRun.NONE, fields=['grantee'], needs_authority=False),
    Command('RESUME_RUN', _resume_run, NeededRun.INTERRUPTED),
    Command('ABORT_RUN', _abort_run, NeededRun.INTERRUPTED),
    Command('NOTE', _note, NeededRun.NONE, fields=['text'], needs_authority=False),
)
"""Every command that there is."""
