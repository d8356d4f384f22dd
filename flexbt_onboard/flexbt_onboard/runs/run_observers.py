# SPDX-License-Identifier: BSD-3-Clause
"""Observers of a run: they bring events of the engine and findings of monitors to journal, event log and operators."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any, Protocol

from flexbt_core.monitors.machine_monitor import MachineMonitor, declared_resources
from flexbt_core.monitors.monitoring import Findings, Monitoring, violation_text
from flexbt_core.monitors.properties import Property, Violation
from flexbt_core.monitors.requirement_text import machine_vocabulary
from flexbt_core.state_machine.engine.operator_commands import CommandReply
from flexbt_core.state_machine.engine.resume import RunPosition
from flexbt_core.state_machine.model.definition import ERROR, ROOT_PATH, MachineDefinition
from flexbt_core.state_machine.model.event_state import ExitReason
from flexbt_core.state_machine.model.state_host import Severity
from flexbt_msgs.msg import BehaviorStructure, ExecutiveLog
from flexbt_onboard.behaviors.run_building import RunRequest
from flexbt_onboard.persistence.reporter import Reporter
from flexbt_onboard.persistence.run_journal import Decided, RunJournal

from .run_snapshot import RunEnd, SnapshotSource


class BehaviorRunObserver(Protocol):
    """Hears of a run, on the thread of the run; ``changed``, ``log`` and ``stopping`` from any thread."""

    def changed(self) -> None:
        """There is another snapshot."""

    def built(self, request: RunRequest, structure: BehaviorStructure) -> None:
        """The behavior is built and begins; :meth:`BehaviorRun.announce` is called when the structure is published."""

    def refused(self, reason: str) -> None:
        """The behavior could not be built. Nothing follows."""

    def log(self, severity: int, path: str, text: str) -> None:
        """A line for the operator."""

    def event(self, event: str, fields: Mapping[str, Any]) -> None:
        """Something for the event log."""

    def moved(self, position: Callable[[], RunPosition], decided: Sequence[Decided]) -> None:
        """The machine is where it was not before, or commands were decided; both are told when this returns."""

    def switched(self, request: RunRequest, structure: BehaviorStructure) -> None:
        """The run goes on with another behavior, whose structure that is; :meth:`moved` follows."""

    def stopping(self, why: str) -> None:
        """The run is told to stop; it is stopped, and shown so, when this returns."""

    def ended(self, end: RunEnd) -> None:
        """The run has ended. Nothing follows."""


# What the engine says of the machine of a run, for operators and the event log.


class MachineObserver:
    """Observer of one machine; see :class:`RunObserver`.

    ``changed()`` is called for what operators are shown. ``source`` is there from when the machine is.
    """

    def __init__(self, observer: BehaviorRunObserver, changed: Callable[[], None]) -> None:
        self.changed = changed
        self.source: SnapshotSource | None = None
        self.why_ended = ''
        """The error of the state whose outcome ends the machine."""
        self._observer = observer
        self._errors: dict[str, str] = {}  # of the active states, the last of each

    def log(self, severity: Severity, path: str, text: str) -> None:
        """A line for the operator."""
        if severity is Severity.ERROR:
            self._errors[path] = text
        self._observer.log(severity.value, path, text)

    def fault(self, path: str, text: str) -> None:
        """A state raised, or did not halt."""
        self._observer.log(ExecutiveLog.ERROR, path, text)
        self._observer.event('fault', {'path': path, 'text': text})

    def transition(self, path: str, outcome: str, target: str, reason: ExitReason) -> None:
        """A state or machine was left."""
        if self.source is not None:
            self.source.left(path)
        fields = {'path': path, 'outcome': outcome, 'target': target, 'reason': reason.name.lower()}
        self._observer.event('left', fields)
        error = self._errors.pop(path, '') if reason is not ExitReason.FORCED else ''
        if target.startswith('/'):
            self.why_ended = ''  # it goes on, whatever it was
        elif error:
            self.why_ended = f'{path}: {error}'
        if reason is ExitReason.FORCED:
            # Told of what is around: it is no reason for what a state wants that is entered again at that moment.
            around, _, label = path.rpartition('/')
            text = f'{label} left by {outcome!r}, as the operator wants it'
            self._observer.log(ExecutiveLog.INFO, around or '/', text)
            self._warn_of_unwritten(path, outcome, target)

    def _warn_of_unwritten(self, path: str, outcome: str, target: str) -> None:
        """A state that was forced out has not written what it writes otherwise; what follows may read it."""
        keys = self.source.machine.unwritten(target) if self.source is not None and target.startswith('/') else []
        if keys:
            text = f'by {outcome!r}, which was forced, {target} follows, and reads what nobody has written'
            self._observer.log(ExecutiveLog.WARN, path, f'{text}: {", ".join(keys)}')


# What is monitored in a run of a behavior, and what becomes of the findings.


class RunMonitors:
    """Used on the thread of the run. Each finding is a line for operators, and an event.

    ``on_first(text)`` gets the first one, ``stop(text)`` each that is to stop the run.
    """

    def __init__(
        self,
        monitoring: Monitoring,
        observer: BehaviorRunObserver,
        on_first: Callable[[str], None],
        stop: Callable[[str], None],
    ) -> None:
        self._monitoring = monitoring
        self._observer = observer
        self._on_first = on_first
        self._stop = stop
        self._findings = Findings(self._found)
        self._machine: MachineMonitor | None = None

    def monitor_for(self, behavior: str, definition: MachineDefinition) -> MachineMonitor | None:
        """Return the monitor of a machine that is about to begin; None when nothing is monitored."""
        if self._monitoring.is_on:
            for problem in self._monitoring.problems_of(behavior, machine_vocabulary(definition)):
                self._observer.log(ExecutiveLog.WARN, '', problem)
            requirements = self._monitoring.requirements_of(behavior)
            self._machine = MachineMonitor(declared_resources(definition), self._findings.add, requirements)
        return self._machine

    def switched(self, definition: MachineDefinition) -> None:
        """The run goes on with another machine."""
        if self._machine is not None:
            self._machine.resources = declared_resources(definition)

    def ended(self, outcome: str, has_goals: bool) -> None:
        """The machine has ended; ``has_goals``: a goal of it is not known to have ended."""
        if self._machine is not None and outcome != ERROR and has_goals:
            text = f'the run has ended by {outcome!r}, and a goal of it goes on'
            self._findings.add(Violation(Property.STOP_STOPS, ROOT_PATH, text))

    def _found(self, violation: Violation) -> None:
        text = violation_text(violation)
        self._observer.log(ExecutiveLog.ERROR, violation.where if violation.where.startswith('/') else '', text)
        self._observer.event('violation', {'property': violation.property.name, 'path': violation.where, 'text': text})
        if violation is self._findings.first:
            self._on_first(text)
        if self._monitoring.stops:
            self._stop(text)


# What a run tells, brought to where it belongs: the journal first, then event log and operators, then its supervisor.
#
# All of it is called on the thread of the run.


class RunListener(Protocol):
    """Hears on any thread how its run goes."""

    def run_changed(self) -> None:
        """There is another snapshot."""

    def run_began(self, structure: BehaviorStructure) -> None:
        """The behavior is built."""

    def run_refused(self, reason: str) -> None:
        """The behavior could not be built."""

    def run_switched(self, structure: BehaviorStructure) -> None:
        """The run goes on with another behavior."""

    def run_stopping(self) -> None:
        """The run was told to stop."""

    def run_ended(self, end: RunEnd) -> None:
        """A run that was built has ended."""


class RunRecorder:
    """Observer of one run; see :class:`BehaviorRunObserver`.

    ``answer`` is that of the command that has started it.
    """

    def __init__(
        self,
        run_id: str,
        behavior: str,
        answer: CommandReply,
        journal: RunJournal,
        report: Reporter,
        owner: RunListener,
    ) -> None:
        self._run_id = run_id
        self._behavior = behavior
        self._answer = answer
        self._journal = journal
        self._report = report
        self._owner = owner
        self._switched_to: tuple[RunRequest, BehaviorStructure] | None = None
        self.changed = owner.run_changed

    def built(self, request: RunRequest, structure: BehaviorStructure) -> None:
        """The behavior is built and begins to run."""
        self._journal.begin(self._run_id, request, self._answer)
        self._report.run_started(self._run_id, request)
        self._owner.run_began(structure)

    def refused(self, reason: str) -> None:
        """The behavior could not be built; the run has ended."""
        self._report.run_refused(self._run_id, self._behavior, reason)
        self._owner.run_refused(reason)

    def log(self, severity: int, path: str, text: str) -> None:
        """A state or the engine has something to say."""
        self._report.log(severity, text, path, self._run_id)

    def event(self, event: str, fields: Mapping[str, Any]) -> None:
        """Something for the event log."""
        self._report.event(event, run=self._run_id, **fields)

    def moved(self, position: Callable[[], RunPosition], decided: Sequence[Decided]) -> None:
        """The machine is where it was not before, or commands were decided."""
        switched, self._switched_to = self._switched_to, None
        request, structure = switched or (None, None)
        for type_name in self._journal.move(self._run_id, position, decided, request):
            self._report.not_journaled(self._run_id, type_name)
        if structure is not None:
            self._owner.run_switched(structure)

    def switched(self, request: RunRequest, structure: BehaviorStructure) -> None:
        """The run goes on with another behavior; its owner is told when that is journaled."""
        self._switched_to, self._behavior = (request, structure), request.entry.name
        self._report.run_switched(self._run_id, request)

    def stopping(self, why: str) -> None:
        """The run is told to stop: it does not go on after a crash."""
        self._journal.end(self._run_id, why)
        self._report.event('stopping', run=self._run_id, why=why)
        self._owner.run_stopping()

    def ended(self, end: RunEnd) -> None:
        """The run has ended, and everything has halted."""
        self._journal.end(self._run_id, end.outcome)
        self._report.run_ended(self._run_id, self._behavior, end.outcome, end.message)
        self._owner.run_ended(end)
