# SPDX-License-Identifier: BSD-3-Clause
"""The events of a behavior's run, beside those of its state machine, and the reader that records them.

A run gives all of them to its readers, in their order: first :class:`RunRecorder` writes them down, then the status of
the run follows from them, then the executive shows and supervises it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

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
    """A run begins to be built."""

    request: RunRequest


@dataclass(slots=True)
class RunBuilt(RunEvent):
    """A behavior is built and begins, or the run goes on with it.

    ``operator_gone`` is what it wants when no operator was there for ``operator_gone_after`` s.
    """

    request: RunRequest
    structure: BehaviorStructure
    operator_gone: OperatorGone
    operator_gone_after: float


@dataclass(slots=True)
class RunRefused(RunEvent):
    """The behavior could not be built. Nothing follows."""

    request: RunRequest
    reason: str


class RunAnnounced(RunEvent):
    """The structure of the run is published."""

    __slots__ = ()


class RunReady(RunEvent):
    """The nodes that the run needs are ready, or were waited for long enough."""

    __slots__ = ()


@dataclass(slots=True)
class SkillsDeclared(RunEvent):
    """An event: the declarations of the states' skills that the run may contradict, by path."""

    skills: Mapping[str, Any]


@dataclass(slots=True)
class RunMoved(RunEvent):
    """The machine is where it was not before, and these commands were ``decided``; on the thread of the run.

    Readers look at the machine while they read this; later it is elsewhere. ``switched`` is the behavior with which the
    run continues, if it is another one.
    """

    machine: MachineRun
    decided: Sequence[CommandDecided] = ()
    switched: RunBuilt | None = None


@dataclass(slots=True)
class ViolationFound(RunEvent):
    """A monitor has found that something is wrong."""

    violation: Violation
    is_first: bool


@dataclass(slots=True)
class StopRequested(RunEvent):
    """The run is requested to stop. From any thread."""

    run_id: str
    why: str


@dataclass(slots=True)
class StopAwaited(RunEvent):
    """An event: part of a run has not stopped yet after a stop. On the executor thread."""

    text: str


@dataclass(slots=True)
class BehaviorEnded(RunEvent):
    """A run that was built has ended. ``outputs`` are the values of the machine's output keys."""

    outcome: str
    message: str
    outputs: Mapping[str, Any]


class RunShown(RunEvent):
    """An event: operators are shown another run, or another level for the next one. On the executor thread."""

    __slots__ = ()


class StatusSent(RunEvent):
    """Operators were sent a status. On the executor thread."""

    __slots__ = ()


class RunRecorder(RunReader):
    """A recorder of a run: to the journal, the event log and the log of the operators."""

    def __init__(self, run_id: str, behavior: str, journal: RunJournal, report: Reporter) -> None:
        self._run_id = run_id
        self._behavior = behavior
        self._journal = journal
        self._report = report

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
                self._started(request)
            case RunStarted(_, active):
                for path in active:
                    self._event('entered', path=path)
            case RunRefused(_, reason):
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
                self._journal.end(run_id, why)  # a run that was requested to stop does not continue after a crash
                self._event('stopping', why=why)
            case BehaviorEnded(outcome, message):
                self._journal.end(run_id, outcome)
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
        what = 'started' if is_new else 'goes on; its active states are entered again'
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
                text = (
                    f'the userdata has a {type_name}, which cannot be journaled: the run could not go on after a crash'
                )
                self._report.log(Severity.WARN.value, text, run_id=self._run_id)


def decision_id(run_id: str, number: str) -> str:
    """Return the name of a decision in this executive: the run numbers its decisions."""
    return f'{run_id[:8]}-{number}'


def decision_number(run_id: str, decision: str) -> str | None:
    """Return the number that the run gave to a decision; None if it is not a decision of this run."""
    prefix = decision_id(run_id, '')
    return decision.removeprefix(prefix) if decision.startswith(prefix) else None
