# SPDX-License-Identifier: BSD-3-Clause
"""One run of a behavior on a thread of its own, so that a state that blocks holds up nobody else.

The thread builds the behavior, then steps its state machine whenever something has happened or is due, and sleeps in
between.
"""

from __future__ import annotations

import threading
import traceback
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from enum import Enum
from typing import Any, Final, Protocol

from flexbt_core.clock import WakeEvent
from flexbt_core.errors import FlexbtError
from flexbt_core.state_machine import (
    ERROR,
    Answer,
    ExitReason,
    MachineDefinition,
    MachineError,
    MachineRun,
    Severity,
    reasons_against,
    start_at,
    switch_machine,
)
from flexbt_msgs.msg import ActiveState, BehaviorStructure, ExecutiveLog, PendingDecision
from flexbt_onboard.behaviors import (
    READY_SECONDS,
    OperatorGone,
    RunContext,
    RunRequest,
    StateServices,
    build,
    checked_inputs,
    structure_message,
)
from flexbt_onboard.commands.command_answers import CommandAnswers, Decided
from flexbt_onboard.errors import ParameterError

from .callback_watch import CallbackWatch
from .run_view import RunView

_ESCAPES: Final = 3
"""Exceptions that may escape from the state machine before the run is given up."""


class RunPhase(Enum):
    """What a run is at."""

    STARTING = 'starting'
    RUNNING = 'running'
    PAUSED = 'paused'
    STOPPING = 'stopping'


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
        """Something for the record (:mod:`flexbt_onboard.record.event_log`)."""

    def run_moved(self, run: BehaviorRun, machine: MachineRun, decided: Sequence[Decided]) -> None:
        """The machine is where it was not before, or commands were decided, which are told when this returns."""

    def run_switched(self, run: BehaviorRun, structure: BehaviorStructure) -> None:
        """The run goes on with another behavior, whose structure that is; :meth:`run_moved` follows."""

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
        self.operator_gone = OperatorGone.CONTINUE
        self.operator_gone_after = 0.0
        """What the behavior wants when no operator has been there for so many seconds; known when it is built."""
        # The host is told of an activity when the state was asked for it here.
        self._tell_activity = services.changed
        self._services = replace(services, changed=self._activity_changed)
        self._observer = observer
        self._wake_event = WakeEvent()
        self._lock = threading.Lock()
        self._stop_reason: str | None = None
        self._is_announced = False
        self._has_nodes = False  # or has waited for them long enough
        self._has_changed = False
        self._has_activity_changed = False  # perhaps: the states have to be asked
        self._is_activity_shown = False  # so that it has to be asked for again
        self._answers = CommandAnswers()
        self._switches: deque[tuple[RunRequest, Answer]] = deque()
        self._machine: MachineRun | None = None
        self.view = RunView(services.runtime.clock, run_id)
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
        if not (self._is_announced and self._has_nodes):
            return RunPhase.STARTING
        return RunPhase.PAUSED if self.view.is_paused else RunPhase.RUNNING

    def announce(self) -> None:
        """The operator knows the structure of the run by now, so that the run may be shown as running."""
        self._is_announced = True

    def active_states(self) -> list[ActiveState]:
        """The active states, and what each of them was doing when it was asked last.

        Code of the states is called on the thread of the run only. They are asked again soon, for the next time.
        """
        self._is_activity_shown = True
        self._wake_event.set()
        return self.view.active_states()

    def decisions(self) -> list[PendingDecision]:
        """What waits for the operator."""
        return self.view.decisions()

    def stop(self, reason: str) -> None:
        """Stop the run; :meth:`RunObserver.run_ended` follows when everything is at rest. The first reason counts."""
        with self._lock:
            if self._stop_reason is not None:
                return
            self._stop_reason = reason
            machine = self._machine
        self._observer.run_event(self, 'stopping', {'why': reason})
        if machine is not None:
            machine.preempt(reason)
        self._observer.changed()

    def nodes_changed(self) -> None:
        """A node that behaviors need has come or gone, or has become ready."""
        self._wake_event.set()

    def confirm(self, decision_id: str, answer: Answer) -> None:
        """Let what a decision asks for happen."""
        own = self.view.own_decision(decision_id)
        if own is None:
            answer(f'decision {decision_id!r} does not belong to this run')
        else:
            self.command(lambda machine, once: machine.confirm(own, once), answer)

    def force(self, path: str, outcome: str, decision_id: str, answer: Answer) -> None:
        """Leave a state by an outcome; ``decision_id`` is the decision that this overrides, or ''."""
        own = self.view.own_decision(decision_id) if decision_id else ''
        if own is None:
            answer(f'decision {decision_id!r} does not belong to this run')
        else:
            self.command(lambda machine, once: machine.force(path, outcome, own, once), answer)

    def set_autonomy(self, level: int, path: str, answer: Answer) -> None:
        """Change the autonomy level of a sub-tree; '' for all."""
        self.command(lambda machine, once: machine.set_autonomy(level, path, once), answer)

    def command(self, send: Callable[[MachineRun, Answer], None], answer: Answer) -> None:
        """Give the machine a command; ``answer`` is told once, on any thread, when its effect can be seen."""
        machine = self._machine
        if machine is None or not self._answers.owe(answer):
            answer('the behavior is being built' if machine is None else 'the run has ended')
            return
        send(machine, lambda reason: self._decide(answer, reason))

    def switch(self, request: RunRequest, answer: Answer) -> None:
        """Go on with another behavior, keeping the active states; it is built on the thread of the run."""

        def ask(_machine: MachineRun, _once: Answer) -> None:
            self._switches.append((request, answer))
            self._wake_event.set()

        self.command(ask, answer)

    def _decide(self, answer: Answer, reason: str | None) -> None:
        self._answers.decide(answer, reason)
        if threading.current_thread() is self._thread:
            self._show()
        else:  # the machine has ended
            self._tell(self._answers.take_decided())

    def _tell(self, decided: Sequence[Decided]) -> None:
        for answer, reason in decided:
            answer(reason)

    # -- observer of the machine; on the thread of the run ----------------------------------------------------------

    def changed(self) -> None:
        """See :class:`flexbt_core.state_machine.RunObserver`."""
        # What is entered is shown at once, since on_enter may take long; all else when the step is over, so that what a
        # command has done and the answer to it are written in one.
        self._has_changed = self._has_activity_changed = True
        machine = self._machine
        if machine is not None and self.view.is_outdated(machine):
            self._show()

    def log(self, severity: Severity, path: str, text: str) -> None:
        """See :class:`flexbt_core.state_machine.RunObserver`."""
        self._observer.run_log(self, severity.value, path, text)

    def fault(self, path: str, text: str) -> None:
        """See :class:`flexbt_core.state_machine.RunObserver`."""
        self._observer.run_log(self, ExecutiveLog.ERROR, path, text)
        self._observer.run_event(self, 'fault', {'path': path, 'text': text})

    def transition(self, path: str, outcome: str, target: str, reason: ExitReason) -> None:
        """See :class:`flexbt_core.state_machine.RunObserver`."""
        self.view.left(path)
        fields = {'path': path, 'outcome': outcome, 'target': target, 'reason': reason.name.lower()}
        self._observer.run_event(self, 'left', fields)
        if reason is ExitReason.FORCED:
            self._observer.run_log(self, ExecutiveLog.INFO, path, f'left by {outcome!r}, as the operator wants it')

    # -- the thread of the run ---------------------------------------------------------------------------------------

    def _main(self) -> None:
        with RunContext(lambda: self._services, self.log).entered():
            self._build_and_drive()

    def _build_and_drive(self) -> None:
        try:
            machine = self._build()
        except BaseException as error:
            self._observer.run_refused(self, self._reason_of(error))
            return
        with self._lock:
            is_stopped = self._stop_reason is not None
            self._machine = machine
        if is_stopped:
            self._observer.run_refused(self, f'stopped before it began: {self._stop_reason}')
            return
        self._observer.run_built(self, structure_message(machine.definition, self.run_id, self.behavior))
        self._await_nodes()
        with CallbackWatch(self._services.runtime.steady, self._held_up):
            outcome, message = self._drive(machine)
        self._answers.close('the run has ended')
        self._tell(self._answers.take_decided())
        values = machine.userdata()
        self.outputs = {key: values[key] for key in machine.definition.output_keys if key in values}
        self._observer.run_ended(self, outcome, message)

    def _build(self) -> MachineRun:
        definition = self._define(self.request)
        at = self.request.at
        if at is not None and (reasons := reasons_against(definition, at)):
            raise ParameterError(f'it cannot go on where it was: {"; ".join(reasons)}')
        return MachineRun(
            definition,
            self._services.runtime.clock,
            self,
            autonomy=self.request.autonomy,
            userdata=checked_inputs(definition, self.request.inputs) if at is None else None,
            services=self._services,
            steady=self._services.runtime.steady,
            on_wake=self._wake_event.set,
        )

    def _await_nodes(self) -> None:
        """A node that is alive, and not ready yet, would let the first state that needs it fail."""
        steady, unready = self._services.runtime.steady, self._services.unready
        deadline = steady.now() + READY_SECONDS
        told: Sequence[str] = ()
        while self._stop_reason is None and (names := unready()):
            if steady.now() >= deadline:
                text = f'begins all the same: {", ".join(names)} not ready after {READY_SECONDS:g} s'
                self._observer.run_log(self, ExecutiveLog.WARN, '', text)
                break
            if names != told:
                self._observer.run_log(self, ExecutiveLog.INFO, '', f'waits until {", ".join(names)} is ready')
                told = names
            self._wake_event.wait(steady, deadline)
        self._has_nodes = True

    def _define(self, request: RunRequest) -> MachineDefinition:
        behavior, definition = build(request)
        self.operator_gone, self.operator_gone_after = behavior.operator_gone, float(behavior.operator_gone_after)
        return definition

    def _switch(self, machine: MachineRun, request: RunRequest, answer: Answer) -> None:
        try:
            definition = self._define(request)
        except BaseException as error:  # code of the behavior
            self._decide(answer, self._reason_of(error))
            return

        def switched(reason: str | None) -> None:
            if reason is None:
                self.request, self.behavior = request, request.entry.name
                self._observer.run_switched(self, structure_message(definition, self.run_id, self.behavior))
            self._decide(answer, reason)

        switch_machine(machine, definition, switched)

    def _reason_of(self, error: BaseException) -> str:
        """Why a behavior could not be built, for the operator."""
        if isinstance(error, MachineError):
            return 'its state machine is wrong:' + ''.join(f'\n- {problem}' for problem in error.problems)
        if isinstance(error, FlexbtError):
            return str(error)
        # Code of the behavior; a thread must not end without saying so.
        self._observer.run_log(self, ExecutiveLog.ERROR, '', ''.join(traceback.format_exception(error)))
        return f'building it raised {type(error).__name__}: {error}'

    def _drive(self, machine: MachineRun) -> tuple[str, str]:
        """Step the machine to its end; gives the outcome and a message."""
        try:
            if self.request.at is None:
                machine.start()
            else:
                start_at(machine, self.request.at)
        except BaseException as error:
            self._escaped(machine, error)
        for _ in range(_ESCAPES):
            try:
                while machine.step():
                    if self._has_changed or self._answers.has_decided:
                        self._show()
                    if self._has_activity_changed or self._is_activity_shown:
                        self._ask_activities()
                    while self._switches:
                        self._switch(machine, *self._switches.popleft())
                    self._wake_event.wait(self._services.runtime.clock, machine.next_wake)
                return machine.outcome or ERROR, machine.message
            except BaseException as error:  # not one that a state may raise: SystemExit, or a fault of the engine
                self._escaped(machine, error)
        return ERROR, 'it could not be ended in order; see the log'

    def _held_up(self, path: str, callback: str, seconds: float) -> None:
        text = f'has been in {callback}() for {seconds:.1f} s and holds up the behavior'
        self._observer.run_log(self, ExecutiveLog.WARN, path, f'{text}: no command has an effect until it returns')

    def _escaped(self, machine: MachineRun, error: BaseException) -> None:
        self._observer.run_log(self, ExecutiveLog.ERROR, '', ''.join(traceback.format_exception(error)))
        machine.abort(f'{type(error).__name__} escaped from the state machine: {error}')

    def _activity_changed(self) -> None:
        self._has_activity_changed = True
        self._wake_event.set()

    def _ask_activities(self) -> None:
        # One that is another one each time it is asked for, such as a time, is not news: the next status has it.
        is_news = self._has_activity_changed
        self._has_activity_changed = self._is_activity_shown = False
        if self.view.ask_activities() and is_news:
            self._tell_activity()

    def _show(self) -> None:
        machine = self._machine
        if machine is not None:
            self._has_changed = False
            for event, fields in self.view.update(machine):
                self._observer.run_event(self, event, fields)
            decided = self._answers.take_decided()
            self._observer.run_moved(self, machine, decided)
            self._tell(decided)
        self._observer.changed()
