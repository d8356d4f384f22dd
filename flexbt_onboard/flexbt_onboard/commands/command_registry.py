# SPDX-License-Identifier: BSD-3-Clause
"""The commands of operators: the requirements and the effect of each.

To add a command, add a constant and its fields to flexbt_msgs/msg/ExecutiveCommand, and an entry to
:attr:`CommandRegistry.COMMANDS`.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from enum import Enum
from typing import Any, Final

from flexbt_common.values.message_fields import options_of, seconds_of
from flexbt_common.values.queue_options import QueueOptions
from flexbt_core.state_machine.engine import operator_commands
from flexbt_core.state_machine.engine.events import CommandDecided
from flexbt_core.values.text import escape_lines, truncate_middle
from flexbt_msgs.msg import BlackboardEntry, ExecutiveCommand, ExecutiveLog
from flexbt_msgs.srv import ControlTree
from flexbt_onboard.behaviors.behavior_library import BehaviorLibrary
from flexbt_onboard.behaviors.run_building import RunRequest, checked_autonomy, run_request
from flexbt_onboard.errors import CommandRefusedError
from flexbt_onboard.link.reporter import Reporter
from flexbt_onboard.link.tree_debugging import TreeDebuggingLink
from flexbt_onboard.mission_queue.mission_queue import MissionQueue
from flexbt_onboard.mission_queue.queue_runner import QueueRunner
from flexbt_onboard.persistence.run_journal import InterruptedRun
from flexbt_onboard.runs.behavior_run import BehaviorRun
from flexbt_onboard.runs.run_snapshot import RunPhase
from flexbt_onboard.runs.run_supervisor import RunSupervisor

from .authority import Authority, OperatorNames
from .command_ledger import CommandHandling
from .input_requests import InputRequests

LOGGED: Final = 1000
"""Maximum characters of a value of a command in the event log."""


_WITH_AUTONOMY: Final = (
    ExecutiveCommand.START,
    ExecutiveCommand.AUTONOMY,
    ExecutiveCommand.QUEUE_ADD,
    ExecutiveCommand.QUEUE_EDIT,
)


class RunRequirement(Enum):
    """The run that a command must name in ``run_id``."""

    NONE = 'none'
    ANY = 'the active run; none while idle'
    RUNNING = 'the active run, when it is running or paused'
    SHOWN = 'the run that the status shows, also when it has ended'
    INTERRUPTED = 'the run that was interrupted'


Effect = Callable[['CommandRegistry', ExecutiveCommand], bool | None]


@dataclass(frozen=True)
class CommandDefinition:
    """The definition of a command. ``name`` is the name of its constant in ExecutiveCommand.

    ``apply`` carries out the command, or raises CommandRefusedError. It returns True if the effect follows later, with
    :class:`CommandDecided`, :class:`RunBuilt` or :class:`RunRefused`. ``fields`` are the fields of the message that
    must not be empty. With ``needs_no_operator``, neither the owner of the operator's name nor the addressed executive
    is checked.
    """

    name: str
    apply: Effect
    run: RunRequirement = RunRequirement.RUNNING
    fields: Sequence[str] = ()
    needs_authority: bool = True
    needs_no_operator: bool = False

    @property
    def kind(self) -> int:
        """Value of the constant."""
        return int(getattr(ExecutiveCommand, self.name))


def _of_machine(name: str, command: Callable[..., str | None], *fields: str) -> CommandDefinition:
    """Return a command that the machine applies between two steps. ``fields`` of the message are its arguments."""

    def apply(registry: CommandRegistry, sent: ExecutiveCommand) -> bool:
        registry.run.command(sent.id, command, *(getattr(sent, field) for field in fields))
        return True

    return CommandDefinition(name, apply, fields=fields)


def _of_trees(name: str, *fields: str) -> CommandDefinition:
    """Return a command for the debugger of the BT server, which knows the trees. TREE_X is ControlTree's X."""
    tree_command = int(getattr(ControlTree.Request, name.removeprefix('TREE_')))

    def apply(registry: CommandRegistry, sent: ExecutiveCommand) -> bool:
        registry.trees.send(sent, tree_command, registry.decided)
        return True

    return CommandDefinition(name, apply, RunRequirement.NONE, fields)


_ENTRY: Final = 'queue_number'
_OPTIONS: Final = 'queue_options'


def _of_queue(
    name: str, command: Callable[[QueueRunner, MissionQueue, ExecutiveCommand], object], *fields: str
) -> CommandDefinition:
    """Return a command of the mission queue, which decides and journals it in one line."""

    def apply(registry: CommandRegistry, sent: ExecutiveCommand) -> None:
        with registry.queue.changing(sent.id) as queue:
            command(registry.queue, queue, sent)

    return CommandDefinition(name, apply, RunRequirement.NONE, fields)


def _of_authority(name: str, command: Callable[..., None], *fields: str) -> CommandDefinition:
    """Return a command about the authority. The authority itself checks whether the operator may send it."""

    def apply(registry: CommandRegistry, sent: ExecutiveCommand) -> None:
        command(registry.authority, sent.operator_id, *(getattr(sent, field) for field in fields))

    return CommandDefinition(name, apply, RunRequirement.NONE, fields, needs_authority=False)


class CommandRegistry(CommandHandling):
    """A registry that checks and applies commands. Used on the executor thread only."""

    def __init__(
        self,
        executive_id: str,
        library: BehaviorLibrary,
        runs: RunSupervisor,
        names: OperatorNames,
        authority: Authority,
        input_requests: InputRequests,
        trees: TreeDebuggingLink,
        queue: QueueRunner,
        report: Reporter,
    ) -> None:
        super().__init__()
        self.trees = trees
        self.queue = queue
        self.decided: Callable[[CommandDecided], None] = lambda event: None
        """Called with the result of a command that another node decides."""
        self._commands = {command.kind: command for command in self.COMMANDS}
        self._executive_id = executive_id
        self._library = library
        self._runs = runs
        self._names = names
        self.authority = authority
        self._input_requests = input_requests
        self._report = report
        self._stopped_at = -math.inf  # when the newest STOP arrived

    def is_addressed(self, command: ExecutiveCommand) -> bool:
        if command.executive_id in ('', self._executive_id):
            return True
        known = self._commands.get(command.kind)
        return known is not None and known.needs_no_operator

    def fields(self, command: ExecutiveCommand) -> dict[str, Any]:
        known = self._commands.get(command.kind)
        return command_fields(command, known.name if known is not None else f'kind {command.kind}')

    def apply(self, command: ExecutiveCommand, writer: bytes, arrived: float) -> bool:
        known = self._commands.get(command.kind)
        if known is None:
            raise CommandRefusedError(f'kind {command.kind} is not supported by this version')
        if not known.needs_no_operator:
            self._names.check(command.operator_id, writer)
        if known.needs_authority:
            self.authority.check(command.operator_id)
        if missing := [name for name in known.fields if not getattr(command, name)]:
            raise CommandRefusedError(f'{known.name} must name {" and ".join(missing)}')
        self._check_run(known.run, command)
        if command.kind == ExecutiveCommand.STOP:
            self._stopped_at = max(self._stopped_at, arrived)
        elif known.needs_authority and arrived <= self._stopped_at:  # a STOP is taken before others that wait
            raise CommandRefusedError('a STOP has arrived after it; give it again if it is meant')
        return not known.apply(self, command)

    def _check_run(self, needed: RunRequirement, command: ExecutiveCommand) -> None:
        """Check that the command names the run that it requires. Raise CommandRefusedError if not."""
        run, interrupted, meant = self._runs.snapshot, self._runs.interrupted, command.run_id
        if needed is RunRequirement.SHOWN:
            shown = self._runs.shown.run_id
            if meant != shown:
                raise CommandRefusedError(f'meant for run {meant or "none"}, but run {shown or "none"} is shown now')
        elif needed is RunRequirement.INTERRUPTED:
            if interrupted is None:
                raise CommandRefusedError('no run was interrupted')
            if interrupted.run_id != meant:
                raise CommandRefusedError(
                    f'meant for run {meant or "none"}, but run {interrupted.run_id} was interrupted'
                )
        elif needed is RunRequirement.ANY and interrupted is not None:
            what = f'behavior {interrupted.behavior!r} was interrupted (run {interrupted.run_id})'
            raise CommandRefusedError(f'{what}; resume or abort it first')
        elif needed is RunRequirement.RUNNING or (needed is RunRequirement.ANY and (run is not None or meant)):
            if run is None:
                raise CommandRefusedError(f'no behavior is running{f"; run {meant} is not active" if meant else ""}')
            if not meant:
                raise CommandRefusedError('the command must name the run that it is meant for in run_id')
            if run.run_id != meant:
                raise CommandRefusedError(f'meant for run {meant}, but run {run.run_id} is active now')
            if needed is RunRequirement.RUNNING and run.phase not in (RunPhase.RUNNING, RunPhase.PAUSED):
                raise CommandRefusedError(f'behavior {run.behavior!r} is {run.phase.value}')

    # -- the effect of each command (flexbt_msgs/msg/ExecutiveCommand) -------------------------------------------------

    @property
    def run(self) -> BehaviorRun:
        """Current run, for commands that require one."""
        assert self._runs.run is not None
        return self._runs.run

    @property
    def _interrupted(self) -> InterruptedRun:
        """Interrupted run, for commands that require one."""
        assert self._runs.interrupted is not None
        return self._runs.interrupted

    def _start(self, command: ExecutiveCommand) -> bool:
        self._runs.start(self._request(command, command.inputs, command.autonomy))
        if command.hold_queue:
            self.queue.hold(f'by {_operator(command)}, with the start of {command.behavior!r}')
        return True

    def _switch(self, command: ExecutiveCommand) -> bool:
        self.run.switch(self._request(command, (), self.run.snapshot.autonomy))
        return True

    def _request(self, command: ExecutiveCommand, inputs: Sequence[BlackboardEntry], autonomy: int) -> RunRequest:
        arguments = [(argument.name, argument.value) for argument in command.arguments]
        by, command_id = command.operator_id, command.id
        return run_request(self._library, command.behavior, arguments, inputs, autonomy, by, command_id)

    def _stop(self, command: ExecutiveCommand) -> None:
        who = _operator(command)
        reason = _because(f'by {who}', command)
        run = self._runs.run
        if self.queue.has_entries:  # it has something that could start
            self.queue.hold(f'STOP {reason}')
        if run is not None and command.run_id not in ('', run.run_id):
            self._report.log(ExecutiveLog.WARN, f'{who} stops what runs, and has seen another run')
        if run is None:
            self._report.log(ExecutiveLog.INFO, f'the robot is stopped {reason}')
        elif run.snapshot.is_stopping:
            run.abort(f'aborted {reason}')
        else:
            run.stop(f'stopped {reason}')
        self._runs.halt_robot()

    def _set_autonomy(self, command: ExecutiveCommand) -> bool:
        level, path = checked_autonomy(command.autonomy), command.path
        if self._runs.run is not None:
            self.run.command(command.id, operator_commands.set_autonomy, level, path)
            return True
        if path:
            raise CommandRefusedError(f'no behavior is running, so there is no state {path!r}')
        self._runs.set_next_autonomy(level)
        return False

    def _transition(self, decision: str) -> str:
        """Return the number of a decision about a transition."""
        if self._input_requests.is_open(decision):
            raise CommandRefusedError(f'decision {decision!r} asks for a value: answer it, or decline')
        return self.run.decision_number(decision)

    def _confirm(self, command: ExecutiveCommand) -> bool:
        self.run.command(command.id, operator_commands.confirm, self._transition(command.decision_id))
        return True

    def _step(self, how: str, command: ExecutiveCommand) -> bool:
        self.run.command(command.id, operator_commands.step, how, self._transition(command.decision_id))
        return True

    def _force(self, command: ExecutiveCommand) -> bool:
        number = self.run.decision_number(command.decision_id) if command.decision_id else ''
        self.run.command(command.id, operator_commands.force, command.path, command.outcome, number)
        return True

    def _answer(self, command: ExecutiveCommand) -> None:
        if len(command.inputs) != 1:
            raise CommandRefusedError(f'ANSWER must carry one value in inputs, not {len(command.inputs)}')
        self._input_requests.answer(command.decision_id, command.inputs[0], command.operator_id)

    def _decline(self, command: ExecutiveCommand) -> None:
        self._input_requests.decline(command.decision_id, command.operator_id, command.reason)

    def _resume_run(self, command: ExecutiveCommand) -> bool:
        run = self._interrupted
        by, command_id = command.operator_id, command.id
        request = run_request(self._library, run.behavior, run.arguments, run.inputs, run.autonomy, by, command_id)
        self._runs.start(replace(request, at=run.position(), queue_entry=run.queue_entry), run.run_id)
        return True

    def _abort_run(self, command: ExecutiveCommand) -> None:
        self._runs.abort(self._interrupted, f'interrupted, and aborted by {_operator(command)}')

    def _note(self, command: ExecutiveCommand) -> None:
        text = '\n'.join(escape_lines(command.text))  # the event log has the note as a command
        self._report.log(
            ExecutiveLog.INFO, f'{command.operator_id or "an operator"} notes: {text}', run_id=command.run_id
        )

    COMMANDS: Final = (
        CommandDefinition('START', _start, RunRequirement.NONE),
        # Everyone who sees a fault must be able to stop the robot, no matter what else they know.
        CommandDefinition('STOP', _stop, RunRequirement.NONE, needs_authority=False, needs_no_operator=True),
        CommandDefinition('AUTONOMY', _set_autonomy, RunRequirement.ANY),
        CommandDefinition('CONFIRM', _confirm, fields=['decision_id']),
        CommandDefinition('FORCE', _force, fields=['path', 'outcome']),
        CommandDefinition('ANSWER', _answer, RunRequirement.SHOWN),
        CommandDefinition('DECLINE', _decline, RunRequirement.SHOWN),
        _of_machine('PAUSE', operator_commands.pause),
        _of_machine('RESUME', operator_commands.resume),
        _of_machine('REPEAT', operator_commands.repeat, 'path'),
        _of_machine('LOCK', operator_commands.lock, 'path'),
        _of_machine('UNLOCK', operator_commands.unlock, 'path'),
        CommandDefinition('STEP_INTO', lambda self, sent: self._step('into', sent), fields=['decision_id']),
        CommandDefinition('STEP_OVER', lambda self, sent: self._step('over', sent), fields=['decision_id']),
        CommandDefinition('STEP_OUT', lambda self, sent: self._step('out', sent), fields=['decision_id']),
        CommandDefinition('SWITCH', _switch),
        _of_machine('BREAKPOINT', operator_commands.set_breakpoint, 'path'),
        _of_machine('CLEAR_BREAKPOINT', operator_commands.clear_breakpoint, 'path'),
        _of_trees('TREE_PAUSE'),
        _of_trees('TREE_STEP'),
        _of_trees('TREE_CONTINUE'),
        _of_trees('TREE_RUN_TO', 'path'),
        _of_trees('TREE_BREAK', 'path'),
        _of_trees('TREE_FORCE', 'path', 'outcome'),
        _of_trees('TREE_DUMMY', 'path', 'outcome'),
        _of_trees('TREE_RECORD'),
        _of_trees('TREE_CLEAR'),
        _of_trees('TREE_SET', 'text'),
        _of_queue('QUEUE_ADD', lambda runner, queue, sent: queue.add(runner.new_entry(sent)), 'behavior', _OPTIONS),
        _of_queue('QUEUE_EDIT', lambda runner, queue, sent: queue.edit(runner.changed_entry(sent)), _ENTRY, _OPTIONS),
        _of_queue('QUEUE_REMOVE', lambda _, queue, sent: queue.remove(sent.queue_number), _ENTRY),
        _of_queue('QUEUE_MOVE', lambda _, queue, sent: queue.move(sent.queue_number, sent.queue_before), _ENTRY),
        _of_queue('QUEUE_HOLD', lambda _, queue, sent: queue.hold(_because(f'by {_operator(sent)}', sent))),
        _of_queue('QUEUE_RELEASE', lambda _, queue, sent: queue.release(sent.queue_number), _ENTRY),
        _of_queue('QUEUE_CLEAR', lambda _, queue, sent: queue.clear(sent.queue_number), _ENTRY),
        _of_authority('CLAIM_AUTHORITY', Authority.claim),
        _of_authority('RELEASE_AUTHORITY', Authority.release),
        _of_authority('HAND_OVER_AUTHORITY', Authority.hand_over, 'grantee'),
        _of_authority('REFUSE_AUTHORITY', Authority.refuse, 'grantee'),
        CommandDefinition('RESUME_RUN', _resume_run, RunRequirement.INTERRUPTED),
        CommandDefinition('ABORT_RUN', _abort_run, RunRequirement.INTERRUPTED),
        CommandDefinition('NOTE', _note, RunRequirement.NONE, fields=['text'], needs_authority=False),
    )
    """Every command."""


def _operator(command: ExecutiveCommand) -> str:
    return f'operator {command.operator_id}' if command.operator_id else 'the operator'


def _because(what: str, command: ExecutiveCommand) -> str:
    return what + (f': {command.reason}' if command.reason else '')


def command_fields(command: ExecutiveCommand, name: str) -> dict[str, Any]:
    """Return the fields of a command that are set, for the event log. Long values are truncated in the middle."""
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
        'tree_run': command.tree_run_id,
        'behavior': command.behavior,
        'arguments': {argument.name: truncate_middle(argument.value, LOGGED) for argument in command.arguments},
        'inputs': {
            entry.key: f'{entry.type}: {truncate_middle(entry.text, LOGGED) or "..."}' for entry in command.inputs
        },
        'grantee': command.grantee,
        'text': command.text,
        'because': command.reason,
    }
    if command.kind in _WITH_AUTONOMY:
        fields['autonomy'] = int(command.autonomy)
    if command.queue_number:
        fields['entry' if command.kind != ExecutiveCommand.QUEUE_RELEASE else 'hold'] = command.queue_number
    if command.kind == ExecutiveCommand.QUEUE_MOVE:
        fields['before'] = command.queue_before
    if command.hold_queue:
        fields['hold_queue'] = True
    for options in command.queue_options:
        set_ones, unset = asdict(options_of(options)), asdict(QueueOptions())
        fields['queue_options'] = {
            name: str(value) if isinstance(value, float) and not math.isfinite(value) else value  # JSON has neither
            for name, value in set_ones.items()
            if value != unset[name]
        }
    for name in ('wait_queue', 'wait_interaction'):
        if 0.0 <= getattr(command, name) < math.inf:
            fields[name] = round(float(getattr(command, name)), 3)
    return {name: value for name, value in fields.items() if value != '' and value != {}}
