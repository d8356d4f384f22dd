# SPDX-License-Identifier: BSD-3-Clause
"""The events of a behavior's run, in addition to those of its state machine, and the reader that records them.

A run passes all events to its readers, in this order: :class:`RunRecorder` records them, the status of the run is
updated, and then the executive publishes and supervises the run.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

from flexbt_core.monitors.monitoring import violation_text
from flexbt_core.monitors.properties import Violation
from flexbt_core.state_machine.engine.events import (
    CommandDecided,
    DecisionAsked,
    DecisionClosed,
    Faulted,
    Logged,
    RunEvent,
    RunReader,
    RunStarted,
    StateEntered,
    StateLeft,
)
from flexbt_core.state_machine.engine.resume import position_of
from flexbt_core.state_machine.engine.run import MachineRun
from flexbt_core.state_machine.model.definition import ERROR
from flexbt_core.state_machine.model.state_host import Severity
from flexbt_msgs.msg import BehaviorStructure
from flexbt_onboard.behaviors.behavior import OperatorGone
from flexbt_onboard.behaviors.run_building import RunRequest
from flexbt_onboard.link.reporter import Reporter
from flexbt_onboard.persistence.run_journal import RunJournal


@dataclass(slots=True)
class RunRequested(RunEvent):
    """The event that a run is requested, and its behavior is going to be built."""

    request: RunRequest


@dataclass(slots=True)
class RunBuilt(RunEvent):
    """The event that a behavior was built, for the start of a run or for a switch to it.

    ``operator_gone`` is its reaction after ``operator_gone_after`` s without a connected operator.
    """

    request: RunRequest
    structure: BehaviorStructure
    operator_gone: OperatorGone
    operator_gone_after: float


@dataclass(slots=True)
class RunRefused(RunEvent):
    """The event that a run could not start. It is the last event of the run, which has no outcome.

    ``is_stopped``: it was stopped before it began.
    """

    request: RunRequest
    message: str
    is_stopped: bool = False
    outcome: ClassVar[str] = ''
    is_forced: ClassVar[bool] = False


class RunAnnounced(RunEvent):
    """The event that the structure of the run was published."""

    __slots__ = ()


class RunReady(RunEvent):
    """The event that the nodes that the run needs are ready, or that the wait for them has timed out."""

    __slots__ = ()


@dataclass(slots=True)
class SkillsDeclared(RunEvent):
    """The event with the claims of the states' skills that the run may contradict, by path."""

    skills: Mapping[str, Any]


@dataclass(slots=True)
class RunMoved(RunEvent):
    """The event that the machine has a new position and has ``decided`` commands. On the thread of the run.

    Readers must inspect the machine while they read this event, since it moves on afterwards. ``switched`` is set if
    the run continues with another behavior.
    """

    machine: MachineRun
    decided: Sequence[CommandDecided] = ()
    switched: RunBuilt | None = None


@dataclass(slots=True)
class ViolationFound(RunEvent):
    """The event that a monitor has found a violation."""

    violation: Violation
    is_first: bool


@dataclass(slots=True)
class StopRequested(RunEvent):
    """The event that a stop of the run was requested. From any thread."""

    run_id: str
    why: str


@dataclass(slots=True)
class StopAwaited(RunEvent):
    """The event that part of a run has not stopped yet after a stop. On the executor thread."""

    text: str


@dataclass(slots=True)
class BehaviorEnded(RunEvent):
    """The event that a run has ended after it was built. ``outputs`` are the values of the output keys.

    ``is_forced``: by an outcome that an operator has forced.
    """

    outcome: str
    message: str
    outputs: Mapping[str, Any]
    is_forced: bool = False


@dataclass(slots=True)
class RunOver(RunEvent):
    """The event that a run has ended, was refused or was aborted, and another one can start. On the executor thread.

    Its readers have read it before another run starts.
    """

    end: BehaviorEnded | RunRefused


class RunShown(RunEvent):
    """The event that the shown run, or the autonomy level for the next run, has changed. On the executor thread."""

    __slots__ = ()


class StatusSent(RunEvent):
    """The event that a status is sent to operators. On the executor thread."""

    __slots__ = ()


class RunRecorder(RunReader):
    """A reader that records a run in the journal, the event log and the operators' log."""

    def __init__(self, run_id: str, behavior: str, journal: RunJournal, report: Reporter) -> None:
        self._run_id = run_id
        self._behavior = behavior
        self._journal = journal
        self._report = report
        self._why_stopped = ''

    def read(self, event: RunEvent) -> None:
        report, run_id = self._report, self._run_id
        match event:
            case StateLeft(path, outcome, target, reason):
                self._event('left', path=path, outcome=outcome, target=target, reason=reason.name.lower())
            case StateEntered(path):
                self._event('entered', path=path)
            case RunMoved():
                self._move(event)
            case Logged(severity, path, text):
                report.log(severity.value, text, path, run_id)
            case Faulted(path, text):
                report.log(Severity.ERROR.value, text, path, run_id)
                self._event('fault', path=path, text=text)
            case DecisionAsked(decision):
                self._event(
                    'waiting',
                    decision=decision_id(run_id, decision.id),
                    path=decision.path,
                    kind=decision.kind.name.lower(),
                    outcome=decision.outcome,
                    outcomes=list(decision.outcomes),
                    required=decision.required,
                    prompt=decision.prompt,
                )
            case DecisionClosed(decision):
                self._event('decided', decision=decision_id(run_id, decision.id))
            case RunBuilt(request):
                self._journal.begin(run_id, request)
                if self._why_stopped:  # just before
                    self._journal.end(run_id, self._why_stopped)
                self._started(request)
            case RunStarted(_, active):
                for path in active:
                    self._event('entered', path=path)
            case RunRefused(message=reason):
                self._event('refused', behavior=self._behavior, why=reason)
                report.log(Severity.ERROR.value, f'behavior {self._behavior!r} cannot start: {reason}', run_id=run_id)
            case SkillsDeclared(skills):
                self._event('skills', skills=skills)
            case ViolationFound(violation):
                text = violation_text(violation)
                path = violation.where if violation.where.startswith('/') else ''
                report.log(Severity.ERROR.value, text, path, run_id)
                self._event('violation', property=violation.property.name, path=violation.where, text=text)
            case StopRequested(_, why):
                self._why_stopped = why
                self._journal.end(run_id, why)  # a stopped run does not resume after a crash
                self._event('stopping', why=why)
            case BehaviorEnded(outcome, message, _, is_forced):
                self._journal.end(run_id, outcome, outcome, message, is_forced=is_forced)
                self._event('ended', behavior=self._behavior, outcome=outcome, message=message)
                severity = Severity.ERROR if outcome == ERROR else Severity.INFO
                text = f'behavior {self._behavior!r} ended with {outcome!r}' + (f': {message}' if message else '')
                report.log(severity.value, text, run_id=run_id)

    def _event(self, event: str, **fields: Any) -> None:
        self._report.event(event, run=self._run_id, **fields)

    def _started(self, request: RunRequest) -> None:
        is_new, name = request.at is None, request.entry.name
        self._event(
            'started' if is_new else 'resumed',
            behavior=name,
            arguments=dict(request.arguments),
            inputs=[entry.key for entry in request.inputs],
            autonomy=request.autonomy,
            by=request.by,
        )
        what = 'started' if is_new else 'continues; its active states are entered again'
        self._report.log(Severity.INFO.value, f'behavior {name!r} {what}', run_id=self._run_id)

    def _move(self, event: RunMoved) -> None:
        switched_to = event.switched.request if event.switched is not None else None
        if switched_to is not None:
            self._behavior = switched_to.entry.name
            arguments = dict(switched_to.arguments)
            self._event('switched', behavior=self._behavior, arguments=arguments, by=switched_to.by)
        if self._journal.has(self._run_id):
            position = position_of(event.machine)
            for type_name in self._journal.move(self._run_id, position, event.decided, switched_to):
                text = f'the userdata has a {type_name}, which cannot be journaled: a crash would end the run'
                self._report.log(Severity.WARN.value, text, run_id=self._run_id)


def decision_id(run_id: str, number: str) -> str:
    """Return the id of a decision within this executive, made from the run and the number within the run."""
    return f'{run_id[:8]}-{number}'


def decision_number(run_id: str, decision: str) -> str | None:
    """Return the number of a decision within its run; None if it does not belong to this run."""
    prefix = decision_id(run_id, '')
    return decision.removeprefix(prefix) if decision.startswith(prefix) else None
