# SPDX-License-Identifier: BSD-3-Clause
"""The onboard behavior executive: runs one behavior at a time, under an operator's supervision.

Everything here happens on the executor thread, except where it says otherwise. A run has its own thread
(:mod:`flexbt_onboard.behavior_run`) and posts here what becomes of it, so that the operator is answered whatever a
behavior does.
"""

from __future__ import annotations

import uuid
from collections.abc import Callable, Mapping, Sequence
from typing import Any, Final

from flexbt_common.action_call import ActionLinks
from flexbt_common.liveliness import LivelinessToken
from flexbt_common.node_runtime import NodeRuntime
from flexbt_common.service_call import ServiceLinks
from flexbt_msgs.msg import BehaviorList, BehaviorStructure, ExecutiveCommand, ExecutiveLog, ExecutiveStatus
from flexbt_onboard.authority import Authority
from flexbt_onboard.behavior_action import BehaviorActionServer
from flexbt_onboard.behavior_library import BehaviorLibrary
from flexbt_onboard.behavior_run import BehaviorRun
from flexbt_onboard.command_answers import CommandAnswer, Decided
from flexbt_onboard.command_table import CommandTable
from flexbt_onboard.errors import CommandRefusedError
from flexbt_onboard.executive_commands import CommandHandlers, command_fields
from flexbt_onboard.executive_parameters import ExecutiveParameters
from flexbt_onboard.executive_status import status_of
from flexbt_onboard.operator_link import OperatorLink, sendable
from flexbt_onboard.operator_questions import OperatorQuestions
from flexbt_onboard.peers import PeersWatch
from flexbt_onboard.record import Record, record_file
from flexbt_onboard.robot_pose import RobotPose
from flexbt_onboard.run_building import RunRequest
from flexbt_onboard.run_view import waiting_fields
from flexbt_onboard.state_machine import ROOT_PATH, Answer, MachineRun
from flexbt_onboard.state_services import StateServices
from flexbt_onboard.status_publisher import StatusPublisher

SHUTDOWN_SECONDS: Final = 1.2
"""How long the end of the process waits for a running behavior to be at rest."""


Ended = Callable[[BehaviorRun, str, str], None]


def _nobody(*_news: object) -> None:
    """Nobody waits for an answer."""


class Executive:
    """The executive on one node. Made and closed by its host; see :func:`flexbt_onboard.onboard_executive.main`.

    ``run`` is the run that goes on, or None; ``last`` tells run_id, behavior, outcome and message of the one before;
    ``autonomy`` is the level that the run began with, or for the next one.
    """

    def __init__(self, runtime: NodeRuntime, parameters: ExecutiveParameters, library: BehaviorLibrary) -> None:
        """Must be called on the executor thread."""
        self.runtime = runtime
        self.library = library
        self.executive_id = uuid.uuid4().hex
        self.autonomy = parameters.autonomy
        self.run: BehaviorRun | None = None
        self.last = ExecutiveStatus()
        self._start_answer: Answer = _nobody  # who waits for the start of the run
        self._ended: Ended = _nobody  # who waits for its end
        self._open_commands: dict[str, ExecutiveCommand] = {}
        self._questions_noted: set[str] = set()
        self._is_closing = False
        self.command_table = CommandTable()
        self._handlers = CommandHandlers(self)
        self.link = OperatorLink(runtime, self.executive_id, parameters.heartbeat_period, self._on_command)
        node_name = runtime.node.get_fully_qualified_name()
        self.record = Record(
            record_file(parameters.record_directory, node_name),
            runtime.clock,
            self._on_record_problem,
            parameters.record_size,
            parameters.record_files,
        )
        self.record.note('executive', state='started', executive=self.executive_id)
        self.authority = Authority(runtime, parameters.authority_timeout, self._on_authority)
        self.questions = OperatorQuestions(runtime, self._on_questions)
        self.pose = RobotPose(runtime, parameters.pose_topic)
        self._status = StatusPublisher(runtime, self._publish_status, parameters.heartbeat_period)
        self._services = StateServices(
            runtime=runtime,
            actions=ActionLinks(runtime),
            services=ServiceLinks(runtime),
            node_name=node_name,
            changed=self.changed,
        )
        self._actions = BehaviorActionServer(self)
        self._token = LivelinessToken(runtime)
        self.peers = PeersWatch(runtime, parameters.peers, self._on_peer)
        runtime.on_fault(self._on_fault)
        self._announce()

    @property
    def level(self) -> int:
        """The operator's current level of autonomy: that of the run, or for the next one."""
        return self.run.view.levels.get(ROOT_PATH, self.autonomy) if self.run is not None else self.autonomy

    @property
    def shown_run_id(self) -> str:
        """The run that the status names: the one that goes on, or the last one."""
        return self.run.run_id if self.run is not None else str(self.last.run_id)

    def changed(self) -> None:
        """Something that the operator is shown has changed; from any thread."""
        self._status.changed()

    def start(self, request: RunRequest, answer: Answer, ended: Ended = _nobody) -> BehaviorRun:
        """Begin a run; ``answer`` gets None when the behavior is built, or the reason why it cannot be.

        ``ended`` gets the run that was built, its outcome and a message. Both are called on the executor thread.

        Raises:
            CommandRefusedError: a run goes on.
        """
        if self._is_closing:
            raise CommandRefusedError('the executive is shutting down')
        if self.run is not None:
            phase = self.run.phase.value
            raise CommandRefusedError(
                f'behavior {self.run.behavior!r} is {phase} (run {self.run.run_id}); stop it first'
            )
        self.autonomy = request.autonomy
        self.run = BehaviorRun(request, uuid.uuid4().hex, self._services, self)
        self._start_answer, self._ended = answer, ended
        self.run.start()
        self.changed()
        return self.run

    def answer_of(self, command: ExecutiveCommand) -> CommandAnswer:
        """What answers a command: applied, or refused for a reason; from any thread."""
        command_id = str(command.id)
        return CommandAnswer(command_id, lambda reason: self.runtime.post(lambda: self._settle(command_id, reason)))

    # What a run tells; on the thread of the run.

    def run_built(self, run: BehaviorRun, structure: BehaviorStructure) -> None:
        """The behavior is built and begins to run."""

        request = run.request
        self.record.note(
            'started',
            run=run.run_id,
            behavior=run.behavior,
            arguments=dict(request.arguments),
            inputs=[entry.key for entry in request.inputs],
            autonomy=request.autonomy,
            by=request.by,
        )

        def publish() -> None:
            # The structure first: a status that names its run can be drawn at once.
            self.link.publish_structure(structure)
            run.announce()
            self._answer_start(None)
            self._status.flush()
            self.link.log(ExecutiveLog.INFO, f'behavior {run.behavior!r} started', run_id=run.run_id)

        self.runtime.post(publish)

    def run_refused(self, run: BehaviorRun, reason: str) -> None:
        """The behavior could not be built; the run has ended."""

        self.record.note('refused', run=run.run_id, behavior=run.behavior, why=reason)

        def refuse() -> None:
            self._end(run, 'error', reason)
            self.link.log(ExecutiveLog.ERROR, f'behavior {run.behavior!r} cannot start: {reason}', run_id=run.run_id)
            self._answer_start(reason)

        self.runtime.post(refuse)

    def run_log(self, run: BehaviorRun, severity: int, path: str, text: str) -> None:
        """A state or the engine has something to say."""
        self.link.log(severity, text, path, run.run_id)

    def run_event(self, run: BehaviorRun, event: str, fields: Mapping[str, Any]) -> None:
        """Something for the record."""
        self.record.note(event, run=run.run_id, **fields)

    def run_moved(self, run: BehaviorRun, machine: MachineRun, decided: Sequence[Decided]) -> None:
        """The machine is where it was not before, or commands were decided."""

    def run_switched(self, run: BehaviorRun, structure: BehaviorStructure) -> None:
        """The run goes on with another behavior."""
        request = run.request
        self.record.note(
            'switched', run=run.run_id, behavior=run.behavior, arguments=dict(request.arguments), by=request.by
        )
        self.runtime.post(lambda: self.link.publish_structure(structure))

    def run_ended(self, run: BehaviorRun, outcome: str, message: str) -> None:
        """The run has ended and everything is at rest, or as far at rest as ``message`` says."""

        self.record.note('ended', run=run.run_id, behavior=run.behavior, outcome=outcome, message=message)

        def end() -> None:
            self._end(run, outcome, message)
            self._ended(run, outcome, message)
            severity = ExecutiveLog.ERROR if outcome == 'error' else ExecutiveLog.INFO
            text = f'behavior {run.behavior!r} ended with {outcome!r}' + (f': {message}' if message else '')
            self.link.log(severity, text, run_id=run.run_id)

        self.runtime.post(end)

    def close(self) -> None:
        """Stop the run, and wait for it for a limited time; on the closing thread, while callbacks still run."""
        run = self.runtime.call(self._begin_to_close)
        if run is not None and not run.join(SHUTDOWN_SECONDS):
            self.link.log(
                ExecutiveLog.ERROR,
                f'behavior {run.behavior!r} was not at rest {SHUTDOWN_SECONDS} s after the stop; leaving it',
                run_id=run.run_id,
            )
        self.runtime.call(self._say_goodbye)
        self.record.note('executive', state='ended', executive=self.executive_id)
        self.record.close()

    def _begin_to_close(self) -> BehaviorRun | None:
        self._is_closing = True
        if self.run is not None:
            self.run.stop('the executive is shutting down')
        return self.run

    def _say_goodbye(self) -> None:
        self.questions.close()
        self._status.flush()

    def _announce(self) -> None:
        entries = self.library.entries.values()
        self.link.publish_behaviors(BehaviorList(behaviors=[entry.to_message() for entry in entries]))
        for entry in entries:
            if entry.error:
                self.link.log(ExecutiveLog.WARN, f'behavior {entry.name!r} of {entry.package} is broken: {entry.error}')
        self.changed()

    def _on_command(self, command: ExecutiveCommand) -> None:
        if not command.id:
            self.link.log(ExecutiveLog.WARN, f'a command of {command.operator_id!r} has no id; it was ignored')
            self.record.note('command', **command_fields(command), effect='ignored', why='it has no id')
            return
        if not self.command_table.admit(command.id):
            self.changed()  # a resend: answered again, applied once
            return
        self._open_commands[command.id] = command
        try:
            is_applied = self._handlers.handle(command)
        except CommandRefusedError as error:
            self._settle(command.id, str(error))
            return
        if is_applied:
            self._settle(command.id, None)

    def _answer_start(self, reason: str | None) -> None:
        answer, self._start_answer = self._start_answer, _nobody
        answer(reason)

    def _settle(self, command_id: str, reason: str | None) -> None:
        effect = 'applied' if reason is None else 'refused'
        self.record.note(
            'command', **command_fields(self._open_commands.pop(command_id)), effect=effect, why=reason or ''
        )
        self.command_table.settle(command_id, None if reason is None else sendable(reason))
        self.changed()

    def _end(self, run: BehaviorRun, outcome: str, message: str) -> None:
        self.last = ExecutiveStatus(
            run_id=run.run_id, behavior=run.behavior, outcome=outcome, message=sendable(message)
        )
        self.autonomy = run.view.levels.get(ROOT_PATH, self.autonomy)
        self.run = None
        self.changed()

    def _publish_status(self) -> None:
        self.link.publish_status(status_of(self))
        self._actions.refresh()

    def _on_authority(self, text: str) -> None:
        self.link.log(ExecutiveLog.INFO, text)
        self.record.note('authority', holder=self.authority.holder, requests=self.authority.requests[:], text=text)
        self.changed()

    def _on_questions(self) -> None:
        pending = {decision.id: decision for decision in self.questions.decisions()}
        for decision_id in pending.keys() - self._questions_noted:
            self.record.note('waiting', run=self.shown_run_id, **waiting_fields(pending[decision_id]))
        for decision_id in self._questions_noted - pending.keys():
            self.record.note('decided', run=self.shown_run_id, decision=decision_id)
        self._questions_noted = set(pending)
        self.changed()

    def _on_record_problem(self, text: str) -> None:
        severity = ExecutiveLog.WARN if text else ExecutiveLog.INFO
        self.runtime.post(lambda: self.link.log(severity, text or 'the record is written again'))

    def _on_peer(self, name: str, alive: bool, seen_before: bool) -> None:
        run_id = self.run.run_id if self.run is not None else ''
        if alive:
            self.link.log(
                ExecutiveLog.INFO, f'{name} is alive {"again" if seen_before else ""}'.rstrip(), run_id=run_id
            )
        else:
            self.link.log(ExecutiveLog.ERROR, f'{name} is not alive any more', run_id=run_id)
        self.changed()

    def _on_fault(self, error: BaseException) -> None:
        self.link.log(ExecutiveLog.ERROR, f'fault in the executive, which goes on: {type(error).__name__}: {error}')


def open_executive(
    runtime: NodeRuntime, parameters: ExecutiveParameters, library: BehaviorLibrary | None = None
) -> Executive:
    """Make an executive on a runtime, which closes it at its end; ``library`` defaults to the installed behaviors."""
    found = BehaviorLibrary.discover() if library is None else library
    executive = runtime.call(lambda: Executive(runtime, parameters, found))
    runtime.on_close(executive.close)
    return executive
