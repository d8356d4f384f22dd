# SPDX-License-Identifier: BSD-3-Clause
"""The onboard behavior executive: runs one behavior at a time, under an operator's supervision.

Everything here happens on the executor thread, except where it says otherwise. A run has its own thread
(:mod:`flexbt_onboard.runs.behavior_run`) and posts here what becomes of it, so that the operator is answered whatever a
behavior does.
"""

from __future__ import annotations

import functools
import uuid
from collections.abc import Callable
from typing import Final

from flexbt_common.calls import ActionLinks, GoalAdmission, ServiceLinks
from flexbt_common.lifecycle import SHUTTING_DOWN
from flexbt_common.liveness import LivelinessToken, PresenceWatch
from flexbt_common.runtime import NodeRuntime
from flexbt_core.state_machine import ERROR, PREEMPTED, ROOT_PATH, Answer
from flexbt_core.values import sendable
from flexbt_msgs.msg import BehaviorStructure, ExecutiveCommand, ExecutiveLog, ExecutiveStatus
from flexbt_onboard.behaviors import BehaviorLibrary, RunRequest, StateServices
from flexbt_onboard.commands.authority import Authority
from flexbt_onboard.commands.command_answers import CommandAnswer
from flexbt_onboard.commands.command_table import CommandTable
from flexbt_onboard.commands.executive_commands import CommandHandlers, command_fields
from flexbt_onboard.commands.operator_questions import OperatorQuestions
from flexbt_onboard.commands.operator_watch import OperatorWatch
from flexbt_onboard.durability.run_journal import InterruptedRun, RunJournal
from flexbt_onboard.errors import CommandRefusedError, OnboardError
from flexbt_onboard.link.executive_status import status_of
from flexbt_onboard.link.operator_link import OperatorLink
from flexbt_onboard.link.peers import PeersWatch
from flexbt_onboard.link.robot_pose import RobotPose
from flexbt_onboard.link.status_publisher import StatusPublisher
from flexbt_onboard.link.userdata_server import UserdataServer
from flexbt_onboard.record.event_log import Record, record_file
from flexbt_onboard.record.executive_events import ExecutiveNews
from flexbt_onboard.record.run_events import RunNews
from flexbt_onboard.runs.behavior_run import BehaviorRun

from .behavior_action import BehaviorActionServer
from .diagnostics import Diagnostics
from .executive_parameters import ExecutiveParameters

SHUTDOWN_SECONDS: Final = 1.2
"""How long the end of the process waits for a running behavior to be at rest."""

Ended = Callable[[BehaviorRun, str, str], None]


def _nobody(*_news: object) -> None:
    """Nobody waits for an answer."""


class Executive:
    """The executive on one node. Made by :func:`open_executive`.

    ``run`` is the run that goes on, or None; ``last`` tells run_id, behavior, outcome and message of the one before;
    ``autonomy`` is the level that the run began with, or for the next one. ``gate`` says why nothing can be started.
    """

    def __init__(
        self, runtime: NodeRuntime, parameters: ExecutiveParameters, library: BehaviorLibrary, refusal: str = ''
    ) -> None:
        """Must be called on the executor thread. ``refusal``: why nothing can be started until it is activated."""
        self.runtime = runtime
        self.library = library
        self.executive_id = uuid.uuid4().hex
        self.autonomy = parameters.autonomy
        self.run: BehaviorRun | None = None
        self.last = ExecutiveStatus()
        self.start_answer: Answer = _nobody  # who waits for the start of the run
        self._ended: Ended = _nobody  # who waits for its end
        self._open_commands: dict[str, ExecutiveCommand] = {}
        self._news = ExecutiveNews(self)
        self.gate = GoalAdmission('the executive', refusal)
        self.command_table = CommandTable()
        self._handlers = CommandHandlers(self)
        self.link = OperatorLink(runtime, self.executive_id, parameters.heartbeat_period, self._on_command)
        node_name = runtime.node.get_fully_qualified_name()
        self.record = Record(
            record_file(parameters.record_directory, node_name),
            runtime.clock,
            functools.partial(self._news.problem, 'record', ExecutiveLog.WARN),
            parameters.record_size,
            parameters.record_files,
        )
        runtime.on_close(self.record.close)
        self.record.note('executive', state='started', executive=self.executive_id)
        self.journal = RunJournal(
            parameters.journal_directory,
            node_name,
            functools.partial(self._news.problem, 'journal', ExecutiveLog.ERROR),
        )
        runtime.on_close(self.journal.close)
        if self.journal.damage:
            self.link.log(ExecutiveLog.ERROR, self.journal.damage)
        self.command_table.restore(self.journal.results)
        presence = PresenceWatch(runtime)
        self.authority = Authority(runtime, presence, parameters.authority_timeout, self._news.authority)
        self._operators = OperatorWatch(runtime, presence, self._news.operators)
        self.questions = OperatorQuestions(runtime, self.gate, self._news.questions)
        self.pose = RobotPose(runtime, parameters.pose_topic)
        self._status = StatusPublisher(runtime, self._publish_status, parameters.heartbeat_period)
        self._services = StateServices(
            runtime=runtime,
            actions=ActionLinks(runtime),
            services=ServiceLinks(runtime),
            node_name=node_name,
            changed=self.changed,
            unready=lambda: self.peers.unready(),
        )
        self._actions = BehaviorActionServer(self)
        UserdataServer(self)
        self._token = LivelinessToken(runtime)
        self.peers = PeersWatch(runtime, parameters.peers, self._news.peer, self._news.peer_ready)
        self._diagnostics = Diagnostics(runtime, lambda: status_of(self), self._news.problems)
        runtime.on_fault(self._news.fault)
        self._news.announce()

    @property
    def level(self) -> int:
        """The operator's current level of autonomy: that of the run, or for the next one."""
        return self.run.view.levels.get(ROOT_PATH, self.autonomy) if self.run is not None else self.autonomy

    @property
    def interrupted(self) -> InterruptedRun | None:
        """The run that the end of the executive interrupted, until an operator decides about it."""
        return self.journal.interrupted if self.run is None else None

    @property
    def shown_run_id(self) -> str:
        """The run that the status names: the one that goes on, was interrupted, or was the last."""
        shown = self.run or self.interrupted or self.last
        return str(shown.run_id)

    def changed(self) -> None:
        """Something that the operator is shown has changed; from any thread."""
        self._status.changed()

    def start(
        self, request: RunRequest, answer: Answer, ended: Ended = _nobody, run_id: str | None = None
    ) -> BehaviorRun:
        """Begin a run; ``answer`` gets None when the behavior is built, or the reason why it cannot be.

        ``ended`` gets the run that was built, its outcome and a message. Both are called on the executor thread.
        ``run_id`` is that of the interrupted run that is to go on.

        Raises:
            CommandRefusedError: the executive is not active, a run goes on, or another one was interrupted.
        """
        if self.gate.refusal:
            raise CommandRefusedError(self.gate.refusal)
        if self.run is not None:
            phase = self.run.phase.value
            raise CommandRefusedError(
                f'behavior {self.run.behavior!r} is {phase} (run {self.run.run_id}); stop it first'
            )
        interrupted = self.interrupted
        if interrupted is not None and interrupted.run_id != run_id:
            raise CommandRefusedError(
                f'behavior {interrupted.behavior!r} was interrupted (run {interrupted.run_id}); '
                'resume or abort it first'
            )
        self.autonomy = request.autonomy
        self.run = BehaviorRun(request, run_id or uuid.uuid4().hex, self._services, RunNews(self))
        self.start_answer, self._ended = answer, ended
        self.run.start()
        self.changed()
        return self.run

    def answer_of(self, command: ExecutiveCommand) -> CommandAnswer:
        """What answers a command: applied, or refused for a reason; from any thread."""
        command_id = str(command.id)
        return CommandAnswer(command_id, lambda reason: self.runtime.post(lambda: self._settle(command_id, reason)))

    def give_up(self, interrupted: InterruptedRun, why: str) -> None:
        """An interrupted run does not go on."""
        self.journal.end(interrupted.run_id, why)
        self.record.note('ended', run=interrupted.run_id, behavior=interrupted.behavior, outcome=PREEMPTED, message=why)
        self._show_last(interrupted.run_id, interrupted.behavior, PREEMPTED, why)

    # What a run tells (flexbt_onboard.record.run_events).

    def run_begins(self, run: BehaviorRun, structure: BehaviorStructure) -> None:
        """The behavior is built."""
        # The structure first: a status that names its run can be drawn at once.
        self.link.publish_structure(structure)
        run.announce()
        self._operators.watch_over(run)
        self._answer_start(None)
        self._status.flush()
        what = 'started' if run.request.at is None else 'goes on; its active states are entered again'
        self.link.log(ExecutiveLog.INFO, f'behavior {run.behavior!r} {what}', run_id=run.run_id)

    def run_cannot_begin(self, run: BehaviorRun, reason: str) -> None:
        """The behavior could not be built."""
        self._end(run, ERROR, reason)
        self.link.log(ExecutiveLog.ERROR, f'behavior {run.behavior!r} cannot start: {reason}', run_id=run.run_id)
        self._answer_start(reason)

    def run_is_over(self, run: BehaviorRun, outcome: str, message: str) -> None:
        """A run that was built has ended."""
        self._end(run, outcome, message)
        self._ended(run, outcome, message)
        severity = ExecutiveLog.ERROR if outcome == ERROR else ExecutiveLog.INFO
        text = f'behavior {run.behavior!r} ended with {outcome!r}' + (f': {message}' if message else '')
        self.link.log(severity, text, run_id=run.run_id)

    def activate(self) -> None:
        """Behaviors can be started from now on. Not on the executor thread."""
        self.runtime.call(self._activate)

    def deactivate(self, why: str, refusal: str, within: float) -> None:
        """Refuse to start behaviors, stop the run and wait for it. Not on the executor thread.

        ``why`` (for what runs) and ``refusal`` follow a subject; ``within`` is in seconds of wall time.

        Raises:
            OnboardError: the behavior was not at rest in this time.
        """
        told = f'the executive {why}'
        run = self.runtime.call(lambda: self._stop(told, refusal))
        is_at_rest = run is None or run.join(within)
        self.runtime.call(lambda: self._withdraw(told))
        if run is not None and not is_at_rest:
            raise OnboardError(f'behavior {run.behavior!r} was not at rest {within:g} s after the stop; leaving it')

    def close(self) -> None:
        """Stop the run, and wait for it for a limited time; on the closing thread, while callbacks still run."""
        try:
            self.deactivate(SHUTTING_DOWN, SHUTTING_DOWN, SHUTDOWN_SECONDS)
        except OnboardError as error:
            self.link.log(ExecutiveLog.ERROR, str(error), run_id=self.shown_run_id)
        self.record.note('executive', state='ended', executive=self.executive_id)

    def _activate(self) -> None:
        if self.gate.refusal:
            self.gate.open()
            self.link.log(ExecutiveLog.INFO, 'the executive is active')
            self.changed()

    def _stop(self, why: str, refusal: str) -> BehaviorRun | None:
        self.gate.close(refusal)
        self.link.log(ExecutiveLog.INFO, self.gate.refusal)
        if self.run is not None:
            self.run.stop(why)
        self.changed()
        return self.run

    def _withdraw(self, why: str) -> None:
        self.questions.close(why)
        self._status.flush()

    def _on_command(self, command: ExecutiveCommand) -> None:
        if not command.id:
            self.link.log(ExecutiveLog.WARN, f'a command of {command.operator_id!r} has no id; it was ignored')
            self.record.note('command', **command_fields(command), effect='ignored', why='it has no id')
            return
        if command.id not in self.command_table and not self._is_meant(command):
            self.record.note('command', **command_fields(command), effect='ignored', why='meant for another executive')
            self.changed()  # the operator learns from the status that this is another one
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

    def _is_meant(self, command: ExecutiveCommand) -> bool:
        """Whether a command is for this executive, which cannot know what another one made of it.

        A stop is, when it is for the run that goes on here, whoever had that run before.
        """
        if command.executive_id in ('', self.executive_id):
            return True
        return command.kind == ExecutiveCommand.STOP and self.run is not None and command.run_id == self.run.run_id

    def _answer_start(self, reason: str | None) -> None:
        answer, self.start_answer = self.start_answer, _nobody
        answer(reason)

    def _settle(self, command_id: str, reason: str | None) -> None:
        effect = 'applied' if reason is None else 'refused'
        self.record.note(
            'command', **command_fields(self._open_commands.pop(command_id)), effect=effect, why=reason or ''
        )
        self.journal.decide(command_id, reason)
        self.command_table.settle(command_id, None if reason is None else sendable(reason))
        self.changed()

    def _end(self, run: BehaviorRun, outcome: str, message: str) -> None:
        self.autonomy = run.view.levels.get(ROOT_PATH, self.autonomy)
        self.run = None
        self._operators.watch_over(None)
        self._show_last(run.run_id, run.behavior, outcome, message)

    def _show_last(self, run_id: str, behavior: str, outcome: str, message: str) -> None:
        self.last = ExecutiveStatus(run_id=run_id, behavior=behavior, outcome=outcome, message=sendable(message))
        self.changed()

    def _publish_status(self) -> None:
        status = status_of(self)
        self.journal.sync()  # nobody is told what a crash could undo
        self.link.publish_status(status)
        self._actions.refresh()


def open_executive(
    runtime: NodeRuntime, parameters: ExecutiveParameters, library: BehaviorLibrary | None = None, refusal: str = ''
) -> Executive:
    """Make an executive on a runtime, which closes it at its end; ``library`` defaults to the installed behaviors."""
    found = BehaviorLibrary.discover() if library is None else library
    executive = runtime.call(lambda: Executive(runtime, parameters, found, refusal))
    runtime.on_close(executive.close)
    return executive
