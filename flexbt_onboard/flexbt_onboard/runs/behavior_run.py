# SPDX-License-Identifier: BSD-3-Clause
"""One run of a behavior on a separate thread, so that a state that blocks delays nothing else.

The thread builds the behavior, then steps its state machine whenever something has happened or is due, and sleeps in
between. Other threads read a :class:`RunSnapshot`, which is published when it is journaled. A stop does not depend on
the thread: it cancels the goals of the run at once. A run whose thread does not return is abandoned.
"""

from __future__ import annotations

import threading
import traceback
from collections import deque
from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager, nullcontext
from dataclasses import replace
from typing import Any, Final

from flexbt_core.clock.waiting import WakeEvent
from flexbt_core.errors import FlexbtError
from flexbt_core.monitors.machine_monitor import MachineMonitor
from flexbt_core.monitors.monitoring import Findings, Monitoring, violation_text
from flexbt_core.monitors.properties import Property, Violation
from flexbt_core.monitors.requirement_text import machine_vocabulary
from flexbt_core.monitors.requirements import Requirement
from flexbt_core.skills.observation import claims
from flexbt_core.state_machine.engine.engine import STOP_TIMEOUT, RunLimits, RunningCallback
from flexbt_core.state_machine.engine.events import (
    CommandDecided,
    DecisionAsked,
    DecisionTaken,
    Faulted,
    Logged,
    MachineEntered,
    OutcomeForced,
    OutcomeTaken,
    RunEnding,
    RunEvent,
    RunReader,
    RunRested,
    StateEntered,
    StateExited,
    StateLeft,
)
from flexbt_core.state_machine.engine.resume import reasons_against, start_at, switch_machine
from flexbt_core.state_machine.engine.run import MachineRun
from flexbt_core.state_machine.model.autonomy import DecisionKind
from flexbt_core.state_machine.model.definition import ERROR, ROOT_PATH, MachineDefinition, StateDefinition
from flexbt_core.state_machine.model.event_state import EXIT_TIMEOUT, ExitReason, state_skill
from flexbt_core.state_machine.model.state_host import Severity
from flexbt_core.state_machine.model.userdata import MachineError
from flexbt_onboard.behaviors.run_building import RunRequest, build, checked_inputs, structure_message
from flexbt_onboard.behaviors.run_context import READY_SECONDS, RunContext, RunGoals, StateServices
from flexbt_onboard.errors import CommandRefusedError, ParameterError

from .blocked_callback_watchdog import BlockedCallback, BlockedCallbackWatchdog
from .run_events import (
    BehaviorEnded,
    RunAnnounced,
    RunBuilt,
    RunMoved,
    RunReady,
    RunRefused,
    RunShown,
    SkillsDeclared,
    StopAwaited,
    StopRequested,
    ViolationFound,
    decision_number,
)
from .run_snapshot import ActivityPoll, RunSnapshot, RunStatus, not_paused_lines

_HAS_ENDED: Final = 'the run has ended'

_ESCAPES: Final = 3
"""Number of exceptions that may escape from the state machine before the run is aborted."""


_UNREAD: Final = (RunRested, RunEnding, MachineEntered, StateExited, OutcomeTaken, DecisionTaken, OutcomeForced)
"""Events that no reader of a run needs. The machine does not create events that nobody reads."""


class BehaviorRun(RunReader):
    """A run of a behavior, from the request to the end. Thread-safe unless a docstring states a thread.

    It reads the events of its state machine, and passes them and its own events to its readers: first to the
    ``recorder``, which journals them, then to the status of the run, and then to the ``readers`` in their order.
    """

    reads = tuple(event for event in RunEvent.__subclasses__() if event not in _UNREAD)

    def __init__(
        self,
        request: RunRequest,
        run_id: str,
        services: StateServices,
        recorder: RunReader,
        readers: Sequence[RunReader],
        stop_timeout: float = STOP_TIMEOUT,
        monitoring: Monitoring | None = None,
    ) -> None:
        """``stop_timeout``: seconds of wall time after a stop, within which everything must have halted."""
        self.run_id = run_id
        self._request = request
        goals = RunGoals()
        self._services = replace(services, changed=self._activity_changed, goals=goals)
        self._status = RunStatus(run_id, request.entry.name, request.autonomy, services.runtime.clock, goals)
        self._readers = [recorder, self._status, *readers]
        self._stop_timeout = stop_timeout
        self._monitoring = monitoring or Monitoring()
        self._findings = Findings(self._violated)
        self._monitor: MachineMonitor | None = None
        self._wake_event = WakeEvent()
        self._lock = threading.Lock()
        self._stop_reason: str | None = None
        self._has_changed = False
        self._activities = ActivityPoll()
        self._errors: dict[str, str] = {}  # last error of each active state, by path
        self._why_ended = ''
        self._is_forced = False  # no state was entered since an operator has forced an outcome that was no answer
        self._choices: set[str] = set()  # paths of the active states that have asked an operator for an outcome
        self._switches: deque[RunRequest] = deque()
        self._switched: RunBuilt | None = None  # reported once it is journaled
        self._has_ended = False
        self._stopped_at = 0.0
        self._building: RunningCallback | None = None
        self._watch = BlockedCallbackWatchdog(
            services.runtime.steady, self._calling, self._held_up, self._no_longer_held_up
        )
        # While the thread does not respond, the executive counts as late for its drivers, and they hold the robot.
        self._loop = services.runtime.health.loop(f'the run of {request.entry.name}', self._where)
        self._machine: MachineRun | None = None
        self._not_begun = 'the behavior is being built'  # the reason why a command can have no effect yet, or ''
        self._thread = threading.Thread(target=self._main, name=f'run_{request.entry.name}', daemon=True)

    def add_reader(self, reader: RunReader) -> None:
        """Pass the events of the run to a further reader from now on."""
        self._readers.append(reader)

    def start(self) -> None:
        """Start building and running the behavior. The run is refused if the computer has no thread left."""
        try:
            self._thread.start()
        except RuntimeError as error:
            self._refuse(f'it cannot begin: {error}; end something that runs on this computer, or raise its limits')

    def join(self, timeout: float) -> bool:
        """Wait up to ``timeout`` seconds for the end of the thread. Return True if it has ended."""
        self._thread.join(timeout)
        return not self._thread.is_alive()

    @property
    def snapshot(self) -> RunSnapshot:
        """Snapshot of the run that was published last."""
        return self._status.snapshot

    def announce(self) -> None:
        """Show the run as running from now on, since operators have received its structure."""
        self._tell(RunAnnounced())

    def ask_activities(self) -> None:
        """Request the activities of the active states for the next status."""
        self._activities.request()
        self._wake_event.set()

    def stop(self, reason: str) -> None:
        """Stop the run. :class:`BehaviorEnded` follows once everything has halted. Only the first reason counts."""
        with self._lock:
            if self._stop_reason is not None:
                return
            self._stop_reason = reason
            self._stopped_at = self._services.runtime.steady.now()
            machine = self._machine
        self._services.goals.stop()  # at once, even if the thread of the run is blocked
        self._tell(StopRequested(self.run_id, reason))
        if machine is not None:
            machine.preempt(reason)

    def abort(self, reason: str) -> None:
        """End a stopped run as an error. Do nothing if it has ended, was not stopped, or less than EXIT_TIMEOUT s ago.

        If a state does not return from a callback, the thread of the run is abandoned. It ends when the callback
        returns, and until then affects only its own goals and states.
        """
        if self._has_ended or self._stop_reason is None:
            return
        if self._services.runtime.steady.now() - self._stopped_at < EXIT_TIMEOUT:
            return
        if self._machine is not None:
            self._machine.abort(reason)
        held = self._watch.held
        if held is not None:
            text = 'its thread is left behind, and ends when that returns'
            self._log(Severity.ERROR, f'{held}: {text}')
            self._loop.close()
            self._end(ERROR, f'{self._stop_reason}; {reason}, while {held}')

    @property
    def has_ended(self) -> bool:
        """True if the end of the run was reported."""
        return self._has_ended

    @property
    def has_goals(self) -> bool:
        """True if a goal of the run is not known to have ended."""
        return bool(self._services.goals)

    def show_not_stopped(self, seconds: float) -> None:
        """Report the parts of the run that have not stopped this many seconds after the stop."""
        held, machine = self._watch.held, self._machine
        halting = machine.not_halted if machine is not None else ''
        shown = [str(held) if held is not None else '', f'{halting} for {seconds:.1f} s' if halting else '']
        if not self._has_ended:
            self._tell(StopAwaited('; '.join(filter(None, shown)) or f'not at rest for {seconds:.1f} s'))

    def nodes_changed(self) -> None:
        """Check the nodes that behaviors need again, since one has appeared, ended, or become ready."""
        self._wake_event.set()

    def decision_number(self, decision: str) -> str:
        """Return the number that the run gave to a decision.

        Raises:
            CommandRefusedError: the decision does not belong to this run.
        """
        number = decision_number(self.run_id, decision)
        if number is None:
            raise CommandRefusedError(f'decision {decision!r} does not belong to this run')
        return number

    def command(self, command_id: object, command: Callable[..., str | None], *arguments: Any) -> None:
        """Pass a command to the machine; see :meth:`MachineRun.command`.

        :class:`CommandDecided` follows exactly once, on any thread, when the effect is visible.
        """
        not_begun, machine = self._not_begun, self._machine  # in this order: the machine is there when it begins
        if not_begun or machine is None:
            self._tell(CommandDecided(command_id, not_begun))
        else:
            machine.command(command_id, command, *arguments)

    def switch(self, request: RunRequest) -> None:
        """Continue with another behavior and keep the active states. The thread of the run builds it.

        The run keeps its durability and its autonomy levels. :class:`CommandDecided` follows.
        """
        with self._lock:
            has_ended = self._has_ended
            if not has_ended:
                self._switches.append(request)
        if has_ended:
            self._tell(CommandDecided(request.command_id, _HAS_ENDED))
        self._wake_event.set()

    def _tell(self, event: RunEvent) -> None:
        for reader in self._readers:
            reader.read(event)

    def _log(self, severity: Severity, text: str, path: str = '') -> None:
        self._tell(Logged(severity, path, text))

    # -- the thread of the run ---------------------------------------------------------------------------------------

    def read(self, event: RunEvent) -> None:
        """Handle an event of the machine."""
        match event:
            case Logged(severity, path, text):
                if severity is Severity.ERROR:
                    self._errors[path] = text
                self._tell(event)
            case CommandDecided():
                if threading.current_thread() is self._thread:
                    self._commit(event)
                self._tell(event)
            case StateEntered():
                # Publish at once, since on_enter may take long. Other events wait for the end of the step, so that the
                # effect of a command and its result are journaled in one line.
                self._is_forced = False
                self._choices.discard(event.path)
                self._tell(event)
                self._activities.changed()
                self._commit()
            case Faulted():
                self._tell(event)
            case _:
                self._tell(event)
                if isinstance(event, DecisionAsked) and event.decision.kind is DecisionKind.CHOICE:
                    self._choices.add(event.decision.path)
                if isinstance(event, StateLeft):
                    self._left(event)
                self._has_changed = True
                self._activities.changed()

    def _left(self, event: StateLeft) -> None:
        is_forced = event.reason is ExitReason.FORCED
        is_choice = event.path in self._choices  # the operator was asked for one of its outcomes
        self._choices.discard(event.path)
        self._is_forced = self._is_forced or (is_forced and not is_choice)
        error = self._errors.pop(event.path, '')
        if event.target.startswith('/'):
            self._why_ended = ''  # the run continues, so the error is not its end
        elif error and not is_forced:
            self._why_ended = f'{event.path}: {error}'
        if is_forced:
            # Log it for the machine around the state. The state itself may be entered again at once, and this
            # text does not explain its later outcomes.
            around, _, label = event.path.rpartition('/')
            self._log(Severity.INFO, f'{label} left by {event.outcome!r}, as the operator wants it', around or '/')
            self._warn_of_unwritten(event)

    def _warn_of_unwritten(self, event: StateLeft) -> None:
        """Warn of userdata that the next state reads, but that no state has written because an outcome was forced."""
        target, machine = event.target, self._machine
        keys = machine.unwritten(target) if machine is not None and target.startswith('/') else []
        if keys:
            text = f'by {event.outcome!r}, which was forced, {target} follows, and reads what nobody has written'
            self._log(Severity.WARN, f'{text}: {", ".join(keys)}', event.path)

    def _violated(self, violation: Violation) -> None:
        self._tell(ViolationFound(violation, violation is self._findings.first))
        if self._monitoring.stops:
            self.stop(violation_text(violation))

    def _main(self) -> None:
        self._services.runtime.default_context.open()  # a state of an earlier run may have shut it down
        with self._watch, RunContext(lambda: self._services, self._log_of_state).entered():
            try:
                self._build_and_drive()
            except BaseException as error:  # a fault of the executive: do not show a dead run as running
                message = 'fault in the executive'
                try:  # without free memory, even formatting the error may fail
                    message += f': {error!r}'
                    self._log(Severity.ERROR, ''.join(traceback.format_exception(error)))
                finally:
                    self._end(ERROR, message)
            finally:
                self._services.goals.stop()  # nothing waits for their results any more

    def _log_of_state(self, severity: Severity, path: str, text: str) -> None:
        self.read(Logged(severity, path, text))

    def _build_and_drive(self) -> None:
        try:
            machine, built = self._build()
        except BaseException as error:
            self._refuse(self._reason_of(error))
            return
        with self._lock:
            is_stopped = self._stop_reason is not None
            self._machine = None if is_stopped else machine
        if is_stopped:
            self._refuse(f'stopped before it began: {self._stop_reason}')
            return
        self._tell(built)
        self._tell_skills(machine.definition)
        self._await_nodes()
        with self._loop:
            outcome, message = self._drive(machine)
        self._end(outcome, message)

    def _refuse(self, reason: str) -> None:
        if self._ends():
            self._tell(RunRefused(self._request, reason, self._stop_reason is not None))
            self._refuse_switches()

    def _end(self, outcome: str, message: str) -> None:
        machine = self._machine
        if machine is None:
            self._refuse(message)
            return
        if not self._ends():
            return
        fault = '; '.join(filter(None, [message, 'fault in the executive at the end of the run']))
        end = BehaviorEnded(ERROR, fault, {})
        try:
            machine.close_commands(_HAS_ENDED)
            self._refuse_switches()
            if self._monitoring.is_on and outcome != ERROR and self.has_goals:
                text = f'the run has ended by {outcome!r}, and a goal of it continues'
                self._findings.add(Violation(Property.STOP_STOPS, ROOT_PATH, text))
            values = machine.userdata()
            outputs = {key: values[key] for key in machine.definition.output_keys if key in values}
            end = BehaviorEnded(outcome, message, outputs, self._is_forced)
        finally:
            self._tell(end)

    def _ends(self) -> bool:
        """Mark the run as ended. Return True for the first call only, so that the end is reported once."""
        with self._lock:
            has_ended, self._has_ended = self._has_ended, True
        return not has_ended

    def _refuse_switches(self) -> None:
        with self._lock:
            refused, self._switches = self._switches, deque()
        for request in refused:
            self._tell(CommandDecided(request.command_id, _HAS_ENDED))

    def _build(self) -> tuple[MachineRun, RunBuilt]:
        request = self._request
        definition, built = self._define(request)
        at = request.at
        if at is not None and (reasons := reasons_against(definition, at)):
            raise ParameterError(f'it cannot continue where it was: {"; ".join(reasons)}')
        machine = MachineRun(
            definition,
            self._services.runtime.clock,
            [self],
            autonomy=request.autonomy,
            userdata=checked_inputs(definition, request.inputs) if at is None else None,
            services=self._services,
            steady=self._services.runtime.steady,
            limits=RunLimits(stop_timeout=self._stop_timeout),
            wake_event=self._wake_event,
        )
        if self._monitoring.is_on:
            requirements = self._requirements_of(request.entry.name, definition)
            self._monitor = MachineMonitor(machine, self._findings.add, requirements)
            machine.add_reader(self._monitor)
        return machine, built

    def _requirements_of(self, behavior: str, definition: MachineDefinition) -> Sequence[Requirement]:
        """Return what a monitor watches for a behavior. Report requirements that name missing parts."""
        for problem in self._monitoring.problems_of(behavior, machine_vocabulary(definition)):
            self._log(Severity.WARN, problem)
        return self._monitoring.requirements_of(behavior)

    def _await_nodes(self) -> None:
        """Wait for nodes that are alive but not ready yet, since the first state that needs one would fail."""
        steady, unready = self._services.runtime.steady, self._services.unready
        deadline = steady.now() + READY_SECONDS
        told: Sequence[str] = ()
        while self._stop_reason is None and (names := unready()):
            if steady.now() >= deadline:
                text = f'begins all the same: {", ".join(names)} not ready after {READY_SECONDS:g} s'
                self._log(Severity.WARN, text)
                break
            if names != told:
                self._not_begun = f'the behavior waits until {", ".join(names)} is ready; repeat it then, or STOP'
                self._log(Severity.INFO, f'waits until {", ".join(names)} is ready')
                told = names
            self._wake_event.wait(steady, deadline)
        self._not_begun = ''
        self._tell(RunReady())

    def _define(self, request: RunRequest) -> tuple[MachineDefinition, RunBuilt]:
        self._building = ('', 'create')
        try:
            behavior, definition = build(request)
        finally:
            self._building = None
        structure = structure_message(definition, self.run_id, request.entry.name)
        return definition, RunBuilt(request, structure, behavior.operator_gone, float(behavior.operator_gone_after))

    def _switch(self, machine: MachineRun, wanted: RunRequest) -> None:
        now = self._request
        request = replace(wanted, autonomy=now.autonomy, is_durable=now.is_durable, queue_entry=now.queue_entry)
        try:
            definition, built = self._define(request)
        except BaseException as error:  # code of the behavior may raise anything
            self.read(CommandDecided(request.command_id, self._reason_of(error)))
            return
        machine.command(request.command_id, self._switch_to, definition, built)

    def _switch_to(self, machine: MachineRun, definition: MachineDefinition, built: RunBuilt) -> str | None:
        """Switch the machine to another behavior. A command that the machine applies between two steps."""
        behavior = built.request.entry.name
        requiring: AbstractContextManager[None] = nullcontext()
        if self._monitor is not None and behavior != self._request.entry.name:  # else what came before counts
            requiring = self._monitor.requiring(self._requirements_of(behavior, definition))
        with requiring:
            refusal = switch_machine(machine, definition)
        if refusal is None:
            self._request, self._switched = built.request, built
            self._tell_skills(definition)
        return refusal

    def _tell_skills(self, definition: MachineDefinition) -> None:
        """Report the claims of the states' skills, so that the run report can list contradictions."""
        leaves = (node for node in definition.nodes() if isinstance(node, StateDefinition))
        told = {leaf.path: said for leaf in leaves if (said := claims(state_skill(leaf.state)))}
        if told:
            self._tell(SkillsDeclared(told))

    def _reason_of(self, error: BaseException) -> str:
        """Return why a behavior could not be built, for the operator."""
        if isinstance(error, MachineError):
            return 'its state machine is wrong:' + ''.join(f'\n- {problem}' for problem in error.problems)
        if isinstance(error, FlexbtError):
            return str(error)
        # The code of the behavior has raised something. Log the traceback for its author.
        self._log(Severity.ERROR, ''.join(traceback.format_exception(error)))
        return f'building it raised {type(error).__name__}: {error}'

    def _drive(self, machine: MachineRun) -> tuple[str, str]:
        """Step the machine until its end. Return the outcome and a message."""
        try:
            if self._request.at is None:
                machine.start()
            else:
                start_at(machine, self._request.at)
            self._has_changed = True  # states may have written userdata when entered
        except BaseException as error:
            self._escaped(machine, error)
        for _ in range(_ESCAPES):
            try:
                while machine.step():
                    if machine.is_ending:
                        self.stop('it ends by a fault')
                    if self._has_changed:
                        self._commit()
                    if self._activities.is_due:
                        self._ask_activities(machine)
                    while self._switches:
                        self._switch(machine, self._switches.popleft())
                    with self._loop.resting():
                        self._wake_event.wait(self._services.runtime.clock, machine.next_wake)
                return machine.outcome or ERROR, machine.message or self._why_ended
            except BaseException as error:  # no exception of a state: SystemExit, or a fault of the engine
                self._escaped(machine, error)
        return ERROR, 'it could not be ended in order; see the log'

    def _calling(self) -> RunningCallback | None:
        machine = self._machine
        return self._building or (machine.calling if machine is not None else None)

    def _where(self) -> str:
        calling = self._calling()
        if calling is None:
            return ''
        path, callback = calling
        return f'in {callback}() of {path or "the behavior"}'

    def _held_up(self, held: BlockedCallback) -> None:
        if self._machine is None:
            return  # the behavior is being built, and the status shows that
        # Without a path, so that it does not replace the state's own reason for a decision.
        text = f'{held}, and holds up the behavior: no command has an effect until it returns'
        self._log(Severity.WARN, text)

    def _no_longer_held_up(self, held: BlockedCallback) -> None:
        if self._machine is None:
            return
        text = f'{held.who} has returned from {held.callback}() after {held.seconds:.1f} s'
        self._log(Severity.WARN, text)

    def _escaped(self, machine: MachineRun, error: BaseException) -> None:
        self._log(Severity.ERROR, ''.join(traceback.format_exception(error)))
        machine.fail(f'{type(error).__name__} escaped from the state machine: {error}')

    def _activity_changed(self) -> None:
        self._activities.changed()
        self._wake_event.set()

    def _ask_activities(self, machine: MachineRun) -> None:
        before = self.snapshot.active
        is_shown = self._activities.ask(self._status, machine)
        for line in not_paused_lines(before, self.snapshot.active):
            self._log(Severity.WARN, line)
        if is_shown:
            self._tell(RunShown())

    def _commit(self, *decided: CommandDecided) -> None:
        """Journal the position of the machine and the decided commands. The readers then publish them."""
        if self._machine is None or self._has_ended:  # a thread that was left behind shows nothing any more
            return
        self._has_changed = False
        switched, self._switched = self._switched, None
        self._tell(RunMoved(self._machine, decided, switched))
