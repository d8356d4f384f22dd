# SPDX-License-Identifier: BSD-3-Clause
"""One run of a behavior on a thread of its own, so that a state that blocks holds up nobody else.

The thread builds the behavior, then steps its state machine whenever something has happened or is due, and sleeps in
between.
"""

from __future__ import annotations

import threading
import traceback
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from enum import Enum
from typing import Any, Final, Protocol

from flexbt_common.bell import Bell
from flexbt_common.errors import FlexbtError
from flexbt_common.values import from_entry
from flexbt_msgs.msg import (
    ActiveState,
    BehaviorStructure,
    BlackboardEntry,
    ExecutiveLog,
    PendingDecision,
    StateStructure,
)
from flexbt_onboard.behavior_library import BehaviorEntry
from flexbt_onboard.errors import ParameterError
from flexbt_onboard.run_context import RunContext
from flexbt_onboard.run_view import RunView
from flexbt_onboard.state_machine import (
    ERROR,
    Answer,
    ExitReason,
    MachineDefinition,
    MachineError,
    MachineRun,
    OperatableStateMachine,
    Severity,
    define,
)
from flexbt_onboard.state_services import StateServices

_ESCAPES: Final = 3
"""Exceptions that may escape from the state machine before the run is given up."""


class RunPhase(Enum):
    """What a run is at."""

    STARTING = 'starting'
    RUNNING = 'running'
    STOPPING = 'stopping'


@dataclass(frozen=True)
class RunRequest:
    """What to run: arguments are pairs of parameter name and text, inputs go to the userdata of the root machine.

    ``by`` is who wants it: an operator, or a program.
    """

    entry: BehaviorEntry
    arguments: Sequence[tuple[str, str]]
    inputs: Sequence[BlackboardEntry]
    autonomy: int
    by: str = ''


class RunObserver(Protocol):
    """Hears of a run, on the thread of the run; ``changed`` and ``run_log`` from any thread."""

    def changed(self) -> None:
        """Something that the operator is shown has changed."""

    def run_built(self, run: BehaviorRun, structure: BehaviorStructure) -> None:
        """The behavior is built and begins; the observer calls :meth:`BehaviorRun.announce` when that is published."""

    def run_refused(self, run: BehaviorRun, reason: str) -> None:
        """The behavior could not be built. Nothing follows."""

    def run_log(self, run: BehaviorRun, severity: int, path: str, text: str) -> None:
        """A line for the operator."""

    def run_event(self, run: BehaviorRun, event: str, fields: Mapping[str, Any]) -> None:
        """Something for the record (:mod:`flexbt_onboard.record`)."""

    def run_ended(self, run: BehaviorRun, outcome: str, message: str) -> None:
        """The run has ended. Nothing follows."""


class BehaviorRun:
    """A run from the request to the end. Thread-safe, except where it says otherwise."""

    def __init__(self, request: RunRequest, run_id: str, services: StateServices, observer: RunObserver) -> None:
        self.run_id = run_id
        self.behavior = request.entry.name
        self.outputs: Mapping[str, Any] = {}
        """Values of the machine's output keys, once the run has ended."""
        self.request = request
        self._services = services
        self._observer = observer
        self._bell = Bell()
        self._lock = threading.Lock()
        self._stop_reason: str | None = None
        self._is_announced = False
        self._has_changed = False
        self._is_over = False
        self._unanswered: list[Answer] = []
        self._machine: MachineRun | None = None
        self._view = RunView(services.runtime.clock, run_id)
        self._thread = threading.Thread(target=self._main, name=f'run_{self.behavior}', daemon=True)

    def start(self) -> None:
        """Begin to build and run the behavior."""
        self._thread.start()

    def join(self, timeout: float) -> bool:
        """Wait for the end of the run; whether it came within ``timeout`` seconds."""
        self._thread.join(timeout)
        return not self._thread.is_alive()

    @property
    def phase(self) -> RunPhase:
        """What the run is at, as far as the operator was told."""
        if self._stop_reason is not None:
            return RunPhase.STOPPING
        return RunPhase.RUNNING if self._is_announced else RunPhase.STARTING

    def announce(self) -> None:
        """The operator knows the structure of the run by now, so that the run may be shown as running."""
        self._is_announced = True

    def active_states(self) -> list[ActiveState]:
        """The active states, and what each of them is doing."""
        return self._view.active_states()

    def decisions(self) -> list[PendingDecision]:
        """What waits for the operator."""
        return self._view.decisions()

    def stop(self, reason: str) -> None:
        """Stop the run; :meth:`RunObserver.run_ended` follows when everything is at rest."""
        with self._lock:
            if self._stop_reason is None:
                self._stop_reason = reason
            machine = self._machine
        if machine is not None:
            machine.preempt(reason)
        self._observer.changed()

    def confirm(self, decision_id: str, answer: Answer) -> None:
        """Let what a decision asks for happen. ``answer`` gets None or the reason why not, once, on any thread."""
        own = self._view.own_decision(decision_id)
        if own is None:
            answer(f'decision {decision_id!r} does not belong to this run')
        else:
            self._command(lambda machine, once: machine.confirm(own, once), answer)

    def force(self, path: str, outcome: str, decision_id: str, answer: Answer) -> None:
        """Leave a state by an outcome; ``decision_id`` is the decision that this overrides, or ''."""
        own = self._view.own_decision(decision_id) if decision_id else ''
        if own is None:
            answer(f'decision {decision_id!r} does not belong to this run')
        else:
            self._command(lambda machine, once: machine.force(path, outcome, own, once), answer)

    def set_autonomy(self, level: int, path: str, answer: Answer) -> None:
        """Change the autonomy level of a sub-tree; '' for all."""
        self._command(lambda machine, once: machine.set_autonomy(level, path, once), answer)

    def _command(self, send: Callable[[MachineRun, Answer], None], answer: Answer) -> None:
        with self._lock:
            machine = self._machine
            if machine is not None and not self._is_over:
                self._unanswered.append(answer)
        if machine is None or self._is_over:
            answer('the behavior is being built' if machine is None else 'the run has ended')
            return

        def once(reason: str | None) -> None:
            with self._lock:
                if answer not in self._unanswered:
                    return
                self._unanswered.remove(answer)
            answer(reason)

        send(machine, once)

    def _answer_the_rest(self) -> None:
        """A command that came while the machine ended is answered as well."""
        with self._lock:
            self._is_over = True
            rest, self._unanswered = self._unanswered, []
        for answer in rest:
            answer('the run has ended')

    # -- observer of the machine; on the thread of the run ----------------------------------------------------------

    def changed(self) -> None:
        """See :class:`flexbt_onboard.state_machine.RunObserver`."""
        # At once, since the next callback of a state may take long; and again when the step is over.
        self._has_changed = True
        self._show()

    def log(self, severity: Severity, path: str, text: str) -> None:
        """See :class:`flexbt_onboard.state_machine.RunObserver`."""
        self._observer.run_log(self, severity.value, path, text)

    def fault(self, path: str, text: str) -> None:
        """See :class:`flexbt_onboard.state_machine.RunObserver`."""
        self._observer.run_log(self, ExecutiveLog.ERROR, path, text)
        self._observer.run_event(self, 'fault', {'path': path, 'text': text})

    def transition(self, path: str, outcome: str, target: str, reason: ExitReason) -> None:
        """See :class:`flexbt_onboard.state_machine.RunObserver`."""
        self._view.left(path)
        fields = {'path': path, 'outcome': outcome, 'target': target, 'reason': reason.name.lower()}
        self._observer.run_event(self, 'left', fields)
        if reason is ExitReason.FORCED:
            self._observer.run_log(self, ExecutiveLog.INFO, path, f'left by {outcome!r}, as the operator wants it')

    # -- the thread of the run ---------------------------------------------------------------------------------------

    def _main(self) -> None:
        with RunContext(self._services, self.log).entered():
            self._build_and_drive()

    def _build_and_drive(self) -> None:
        try:
            machine = self._build()
        except MachineError as error:
            problems = ''.join(f'\n- {problem}' for problem in error.problems)
            self._observer.run_refused(self, f'its state machine is wrong:{problems}')
            return
        except FlexbtError as error:
            self._observer.run_refused(self, str(error))
            return
        except BaseException as error:  # code of the behavior; a thread must not end without saying so
            self._observer.run_log(self, ExecutiveLog.ERROR, '', traceback.format_exc())
            self._observer.run_refused(self, f'building it raised {type(error).__name__}: {error}')
            return
        with self._lock:
            is_stopped = self._stop_reason is not None
            self._machine = machine
        if is_stopped:
            self._observer.run_refused(self, f'stopped before it began: {self._stop_reason}')
            return
        self._observer.run_built(self, _structure(machine.definition, self.run_id, self.behavior))
        outcome, message = self._drive(machine)
        self._answer_the_rest()
        values = machine.userdata()
        self.outputs = {key: values[key] for key in machine.definition.output_keys if key in values}
        self._observer.run_ended(self, outcome, message)

    def _build(self) -> MachineRun:
        behavior = self.request.entry.instantiate()
        behavior.set_arguments(self.request.arguments)
        machine: Any = behavior.create()
        if not isinstance(machine, OperatableStateMachine):
            raise ParameterError(f'create() has to return an OperatableStateMachine, not {machine!r:.60}')
        definition = define(machine)
        return MachineRun(
            definition,
            self._services.runtime.clock,
            self,
            autonomy=self.request.autonomy,
            userdata=_checked_inputs(definition, self.request.inputs),
            services=self._services,
            steady=self._services.runtime.steady,
            on_wake=self._bell.ring,
        )

    def _drive(self, machine: MachineRun) -> tuple[str, str]:
        """Step the machine to its end; gives the outcome and a message."""
        try:
            machine.start()
        except BaseException as error:
            self._escaped(machine, error)
        for _ in range(_ESCAPES):
            try:
                while machine.step():
                    if self._has_changed:
                        self._has_changed = False
                        self._show()
                    self._bell.wait(self._services.runtime.clock, machine.next_wake)
                return machine.outcome or ERROR, machine.message
            except BaseException as error:  # not one that a state may raise: SystemExit, or a fault of the engine
                self._escaped(machine, error)
        return ERROR, 'it could not be ended in order; see the log'

    def _escaped(self, machine: MachineRun, error: BaseException) -> None:
        self._observer.run_log(self, ExecutiveLog.ERROR, '', ''.join(traceback.format_exception(error)))
        machine.abort(f'{type(error).__name__} escaped from the state machine: {error}')

    def _show(self) -> None:
        machine = self._machine
        if machine is not None:
            for event, fields in self._view.update(machine):
                self._observer.run_event(self, event, fields)
        self._observer.changed()


def _structure(definition: MachineDefinition, run_id: str, behavior: str) -> BehaviorStructure:
    return BehaviorStructure(
        run_id=run_id,
        behavior=behavior,
        states=[
            StateStructure(
                path=entry.path,
                kind=entry.kind.value,
                type=entry.type_name,
                children=list(entry.children),
                outcomes=list(entry.outcomes),
                targets=list(entry.targets),
                autonomy=list(entry.autonomy),
            )
            for entry in definition.structure()
        ],
    )


def _checked_inputs(definition: MachineDefinition, inputs: Sequence[BlackboardEntry]) -> dict[str, Any]:
    """The values of the inputs by userdata key; all that are needed, and no others."""
    accepted = {*definition.input_keys, *definition.defaults}
    values: dict[str, Any] = {}
    for entry in inputs:
        if entry.key not in accepted:
            known = ', '.join(sorted(accepted)) or 'none'
            raise ParameterError(f'input {entry.key!r} is no userdata key of the behavior; it takes: {known}')
        if entry.key in values:
            raise ParameterError(f'input {entry.key!r} is given twice')
        values[entry.key] = from_entry(entry)
    for key in definition.input_keys:
        if key not in values and key not in definition.defaults:
            raise ParameterError(f'input {key!r} is needed and has no default; give it with the start')
    return values
