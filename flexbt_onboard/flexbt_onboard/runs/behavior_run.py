# SPDX-License-Identifier: BSD-3-Clause
"""One run of a behavior on a thread of its own, so that a state that blocks holds up nobody else.

The thread builds the behavior, then steps its state machine whenever something has happened or is due, and sleeps in
between. What others see of it is a :class:`RunSnapshot`, which is published when it is journaled. A stop needs nothing
of the thread: it cancels the goals of the run at once, and a run whose thread does not return is left behind.
"""

from __future__ import annotations

import threading
import traceback
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any, Final

from flexbt_core.clock.waiting import WakeEvent
from flexbt_core.errors import FlexbtError
from flexbt_core.monitors.monitoring import Monitoring
from flexbt_core.skills.observation import claims
from flexbt_core.state_machine.engine.engine import RunningCallback
from flexbt_core.state_machine.engine.operator_commands import CommandReply
from flexbt_core.state_machine.engine.resume import position_of, reasons_against, start_at, switch_machine
from flexbt_core.state_machine.engine.run import STOP_TIMEOUT, MachineRun
from flexbt_core.state_machine.model.definition import ERROR, ROOT_PATH, MachineDefinition, StateDefinition
from flexbt_core.state_machine.model.event_state import EXIT_TIMEOUT, state_skill
from flexbt_core.state_machine.model.userdata import MachineError
from flexbt_msgs.msg import ExecutiveLog
from flexbt_onboard.behaviors.behavior import Behavior
from flexbt_onboard.behaviors.run_building import RunRequest, build, checked_inputs, structure_message
from flexbt_onboard.behaviors.run_context import READY_SECONDS, RunContext, RunGoals, StateServices
from flexbt_onboard.errors import ParameterError
from flexbt_onboard.persistence.run_journal import Decided

from .blocked_callback_watchdog import BlockedCallback, BlockedCallbackWatchdog
from .run_observers import BehaviorRunObserver, MachineObserver, RunMonitors
from .run_snapshot import ActivityPoll, RunEnd, RunSnapshot, SnapshotSource, decision_number, not_paused_lines

_HAS_ENDED: Final = 'the run has ended'

_ESCAPES: Final = 3
"""Exceptions that may escape from the state machine before the run is aborted."""


class BehaviorRun:
    """A run from the request to the end. Thread-safe, except where it says otherwise."""

    def __init__(
        self,
        request: RunRequest,
        run_id: str,
        services: StateServices,
        observer: BehaviorRunObserver,
        stop_timeout: float = STOP_TIMEOUT,
        monitoring: Monitoring | None = None,
    ) -> None:
        """``stop_timeout``: seconds of wall time after a stop in which everything has to be confirmed at rest."""
        self.run_id = run_id
        self._request = request
        self._services = replace(services, changed=self._activity_changed, goals=RunGoals())
        self._observer = observer
        self._stop_timeout = stop_timeout
        self._monitors = RunMonitors(
            monitoring or Monitoring(), observer, lambda text: self._publish(wrong=text), self.stop
        )
        self._machine_observer = MachineObserver(observer, self._machine_changed)
        self._wake_event = WakeEvent()
        self._lock = threading.Lock()
        self._snapshot = RunSnapshot(run_id, request.entry.name, {ROOT_PATH: request.autonomy})
        self._stop_reason: str | None = None
        self._has_changed = False
        self._activities = ActivityPoll()
        self._decided: list[Decided] = []  # to be told when it is journaled
        self._switches: deque[tuple[RunRequest, CommandReply]] = deque()
        self._has_ended = False
        self._stopped_at = 0.0
        self._building: RunningCallback | None = None
        self._watch = BlockedCallbackWatchdog(
            services.runtime.steady, self._calling, self._held_up, self._no_longer_held_up
        )
        # While it does not answer, the executive is late for those who drive for it, and they keep the robot at rest.
        self._loop = services.runtime.health.loop(f'the run of {request.entry.name}', self._where)
        self._machine: MachineRun | None = None
        self._source: SnapshotSource | None = None
        self._thread = threading.Thread(target=self._main, name=f'run_{request.entry.name}', daemon=True)

    def start(self) -> None:
        """Begin to build and run the behavior; it is refused when the computer has no thread left for it."""
        try:
            self._thread.start()
        except RuntimeError as error:
            self._refuse(f'it cannot begin: {error}; end something that runs on this computer, or raise its limits')

    def join(self, timeout: float) -> bool:
        """Wait for the end of the run; whether it came within ``timeout`` seconds."""
        self._thread.join(timeout)
        return not self._thread.is_alive()

    @property
    def snapshot(self) -> RunSnapshot:
        """The run as it was published last."""
        return self._snapshot

    def announce(self) -> None:
        """The operator knows the structure of the run by now, so that the run may be shown as running."""
        self._publish(is_announced=True)

    def ask_activities(self) -> None:
        """Have the active states asked what they are doing, for the next time that they are shown."""
        self._activities.request()
        self._wake_event.set()

    def stop(self, reason: str) -> None:
        """Stop the run; :meth:`BehaviorRunObserver.ended` follows when all has halted. The first reason counts."""
        with self._lock:
            if self._stop_reason is not None:
                return
            self._stop_reason = reason
            self._stopped_at = self._services.runtime.steady.now()
            machine = self._machine
        self._services.goals.stop()  # at once, whatever the thread of the run is doing
        self._observer.stopping(reason)
        if machine is not None:
            machine.preempt(reason)
        self._publish(is_stopping=True)

    def abort(self, reason: str) -> None:
        """End a run as an error that was stopped and is not at rest in its time; before that nothing happens.

        When a state does not return from a callback, the thread of the run is left behind: it ends when the callback
        returns, and has no effect on anything but its own goals and states any more.
        """
        if self._stop_reason is None or self._services.runtime.steady.now() - self._stopped_at < EXIT_TIMEOUT:
            return
        if self._machine is not None:
            self._machine.abort(reason)
        held = self._watch.held
        if held is not None:
            text = 'its thread is left behind, and ends when that returns'
            self._observer.log(ExecutiveLog.ERROR, '', f'{held}: {text}')
            self._loop.close()
            self._end(ERROR, f'{self._stop_reason}; {reason}, while {held}')

    @property
    def has_ended(self) -> bool:
        """Whether its end was told."""
        return self._has_ended

    @property
    def has_goals(self) -> bool:
        """Whether a goal of it is not known to have ended."""
        return bool(self._services.goals)

    def show_not_stopped(self, seconds: float) -> None:
        """Show what has not stopped so many seconds after the stop."""
        held, machine = self._watch.held, self._machine
        halting = machine.not_halted if machine is not None else ''
        shown = [str(held) if held is not None else '', f'{halting} for {seconds:.1f} s' if halting else '']
        if not self._has_ended:
            self._publish(not_stopped='; '.join(filter(None, shown)) or f'not at rest for {seconds:.1f} s')

    def nodes_changed(self) -> None:
        """A node that behaviors need has come or gone, or has become ready."""
        self._wake_event.set()

    def confirm(self, decision: str, answer: CommandReply) -> None:
        """Let what a decision asks for happen."""
        number = decision_number(self.run_id, decision)
        if number is None:
            answer(f'decision {decision!r} does not belong to this run')
        else:
            self.command(lambda machine, once: machine.confirm(number, once), answer)

    def force(self, path: str, outcome: str, decision: str, answer: CommandReply) -> None:
        """Leave a state by an outcome; ``decision`` is the one that this overrides, or ''."""
        number = decision_number(self.run_id, decision) if decision else ''
        if number is None:
            answer(f'decision {decision!r} does not belong to this run')
        else:
            self.command(lambda machine, once: machine.force(path, outcome, number, once), answer)

    def command(self, send: Callable[[MachineRun, CommandReply], None], answer: CommandReply) -> None:
        """Give the machine a command; ``answer`` is told once, on any thread, when its effect can be seen."""
        machine = self._machine
        if machine is None:
            answer('the behavior is being built')
        else:
            send(machine, lambda reason: self._decide(answer, reason))

    def switch(self, request: RunRequest, answer: CommandReply) -> None:
        """Go on with another behavior, keeping the active states; it is built on the thread of the run.

        The run stays as durable as it was, and keeps its levels of autonomy.
        """
        with self._lock:
            has_ended = self._has_ended
            if not has_ended:
                self._switches.append((request, answer))
        if has_ended:
            answer(_HAS_ENDED)
        self._wake_event.set()

    def _decide(self, answer: CommandReply, reason: str | None) -> None:
        if threading.current_thread() is self._thread:
            self._decided.append((answer, reason))
            self._commit()
        else:  # the machine has ended
            answer(reason)

    def _publish(self, **changes: Any) -> None:
        with self._lock:
            self._snapshot = replace(self._snapshot, **changes)
        self._observer.changed()

    # -- the thread of the run ---------------------------------------------------------------------------------------

    def _machine_changed(self) -> None:
        # What is entered is shown at once, since on_enter may take long; all else when the step is over, so that what a
        # command has done and the answer to it are written in one.
        self._has_changed = True
        self._activities.changed()
        if self._source is not None and self._source.is_outdated():
            self._commit()

    def _main(self) -> None:
        self._services.runtime.default_context.open()  # a state of the run before may have shut it down
        with self._watch, RunContext(lambda: self._services, self._machine_observer.log).entered():
            try:
                self._build_and_drive()
            except BaseException as error:  # a fault of ours: a run that nobody drives must not be shown as one
                message = 'fault in the executive'
                try:  # without memory, even what it was cannot be said
                    message += f': {error!r}'
                    self._observer.log(ExecutiveLog.ERROR, '', ''.join(traceback.format_exception(error)))
                finally:
                    self._end(ERROR, message)
            finally:
                self._services.goals.stop()  # nobody is left to wait for their results

    def _build_and_drive(self) -> None:
        clock = self._services.runtime.clock
        try:
            machine = self._build()
            structure = structure_message(machine.definition, self.run_id, self._request.entry.name)
        except BaseException as error:
            self._refuse(self._reason_of(error))
            return
        source = SnapshotSource(machine, clock, self.run_id, self._services.goals)
        self._source = self._machine_observer.source = source
        with self._lock:
            is_stopped = self._stop_reason is not None
            self._machine = None if is_stopped else machine
        if is_stopped:
            self._refuse(f'stopped before it began: {self._stop_reason}')
            return
        self._observer.built(self._request, structure)
        self._tell_skills(machine.definition)
        self._await_nodes()
        with self._loop:
            outcome, message = self._drive(machine, source)
        self._end(outcome, message)

    def _refuse(self, reason: str) -> None:
        if self._ends():
            self._observer.refused(reason)
            self._refuse_switches()

    def _end(self, outcome: str, message: str) -> None:
        machine = self._machine
        if machine is None:
            self._refuse(message)
            return
        if not self._ends():
            return
        end = RunEnd(ERROR, '; '.join(filter(None, [message, 'fault in the executive at the end of the run'])))
        try:
            machine.close_commands(_HAS_ENDED)
            self._refuse_switches()
            self._monitors.ended(outcome, self.has_goals)
            values = machine.userdata()
            outputs = {key: values[key] for key in machine.definition.output_keys if key in values}
            end = RunEnd(outcome, message, outputs)
        finally:
            self._observer.ended(end)

    def _ends(self) -> bool:
        """Return whether the end is still to be told; it is told once."""
        with self._lock:
            has_ended, self._has_ended = self._has_ended, True
        return not has_ended

    def _refuse_switches(self) -> None:
        with self._lock:
            refused, self._switches = self._switches, deque()
        for _, answer in refused:
            answer(_HAS_ENDED)

    def _build(self) -> MachineRun:
        behavior, definition = self._define(self._request)
        self._publish(**_when_gone(behavior))
        at = self._request.at
        if at is not None and (reasons := reasons_against(definition, at)):
            raise ParameterError(f'it cannot go on where it was: {"; ".join(reasons)}')
        return MachineRun(
            definition,
            self._services.runtime.clock,
            self._machine_observer,
            autonomy=self._request.autonomy,
            userdata=checked_inputs(definition, self._request.inputs) if at is None else None,
            services=self._services,
            steady=self._services.runtime.steady,
            stop_timeout=self._stop_timeout,
            on_wake=self._wake_event.set,
            monitor=self._monitors.monitor_for(self._request.entry.name, definition),
        )

    def _await_nodes(self) -> None:
        """A node that is alive, and not ready yet, would let the first state that needs it fail."""
        steady, unready = self._services.runtime.steady, self._services.unready
        deadline = steady.now() + READY_SECONDS
        told: Sequence[str] = ()
        while self._stop_reason is None and (names := unready()):
            if steady.now() >= deadline:
                text = f'begins all the same: {", ".join(names)} not ready after {READY_SECONDS:g} s'
                self._observer.log(ExecutiveLog.WARN, '', text)
                break
            if names != told:
                self._observer.log(ExecutiveLog.INFO, '', f'waits until {", ".join(names)} is ready')
                told = names
            self._wake_event.wait(steady, deadline)
        self._publish(has_begun=True)

    def _define(self, request: RunRequest) -> tuple[Behavior, MachineDefinition]:
        self._building = RunningCallback('', 'create')
        try:
            return build(request)
        finally:
            self._building = None

    def _switch(self, machine: MachineRun, wanted: RunRequest, answer: CommandReply) -> None:
        request = replace(wanted, autonomy=self._request.autonomy, is_durable=self._request.is_durable)
        try:
            behavior, definition = self._define(request)
            structure = structure_message(definition, self.run_id, request.entry.name)
        except BaseException as error:  # code of the behavior
            self._decide(answer, self._reason_of(error))
            return

        def switched(reason: str | None) -> None:
            if reason is None:
                self._request = request
                self._monitors.switched(definition)
                self._publish(**_when_gone(behavior))
                self._observer.switched(request, structure)
                self._tell_skills(definition)
            self._decide(answer, reason)

        switch_machine(machine, definition, switched)

    def _tell_skills(self, definition: MachineDefinition) -> None:
        """What the skills of the states say that the run may contradict, for its report."""
        leaves = (node for node in definition.nodes() if isinstance(node, StateDefinition))
        told = {leaf.path: said for leaf in leaves if (said := claims(state_skill(leaf.state)))}
        if told:
            self._observer.event('skills', {'skills': told})

    def _reason_of(self, error: BaseException) -> str:
        """Why a behavior could not be built, for the operator."""
        if isinstance(error, MachineError):
            return 'its state machine is wrong:' + ''.join(f'\n- {problem}' for problem in error.problems)
        if isinstance(error, FlexbtError):
            return str(error)
        # Code of the behavior; a thread must not end without saying so.
        self._observer.log(ExecutiveLog.ERROR, '', ''.join(traceback.format_exception(error)))
        return f'building it raised {type(error).__name__}: {error}'

    def _drive(self, machine: MachineRun, source: SnapshotSource) -> tuple[str, str]:
        """Step the machine to its end; gives the outcome and a message."""
        try:
            if self._request.at is None:
                machine.start()
            else:
                start_at(machine, self._request.at)
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
                        self._ask_activities(source)
                    while self._switches:
                        self._switch(machine, *self._switches.popleft())
                    with self._loop.resting():
                        self._wake_event.wait(self._services.runtime.clock, machine.next_wake)
                return machine.outcome or ERROR, machine.message or self._machine_observer.why_ended
            except BaseException as error:  # not one that a state may raise: SystemExit, or a fault of the engine
                self._escaped(machine, error)
        return ERROR, 'it could not be ended in order; see the log'

    def _calling(self) -> RunningCallback | None:
        machine = self._machine
        return self._building or (machine.calling if machine is not None else None)

    def _where(self) -> str:
        calling = self._calling()
        return f'in {calling.callback}() of {calling.path or "the behavior"}' if calling is not None else ''

    def _held_up(self, held: BlockedCallback) -> None:
        if self._machine is None:
            return  # it is being built, and the status says so
        # The executive's own word, without a path: the state may have said why it wants what it wants.
        text = f'{held}, and holds up the behavior: no command has an effect until it returns'
        self._observer.log(ExecutiveLog.WARN, '', text)

    def _no_longer_held_up(self, held: BlockedCallback) -> None:
        if self._machine is None:
            return
        text = f'{held.who} has returned from {held.callback}() after {held.seconds:.1f} s'
        self._observer.log(ExecutiveLog.WARN, '', text)

    def _escaped(self, machine: MachineRun, error: BaseException) -> None:
        self._observer.log(ExecutiveLog.ERROR, '', ''.join(traceback.format_exception(error)))
        machine.fail(f'{type(error).__name__} escaped from the state machine: {error}')

    def _activity_changed(self) -> None:
        self._activities.changed()
        self._wake_event.set()

    def _ask_activities(self, source: SnapshotSource) -> None:
        before = self._snapshot.active
        active, is_shown = self._activities.ask(source, before)
        for line in not_paused_lines(before, active):
            self._observer.log(ExecutiveLog.WARN, '', line)
        with self._lock:
            self._snapshot = replace(self._snapshot, active=active)
        if is_shown:
            self._observer.changed()

    def _commit(self) -> None:
        """Journal where the machine is, then publish it, then answer the commands that brought it there."""
        machine, source = self._machine, self._source
        if machine is None or source is None:
            return
        self._has_changed = False
        fields, events = source.take(self._snapshot)
        for event, of_event in events:
            self._observer.event(event, of_event)
        decided, self._decided = self._decided, []
        self._observer.moved(lambda: position_of(machine), decided)
        self._publish(behavior=self._request.entry.name, **fields)
        for answer, reason in decided:
            answer(reason)


def _when_gone(behavior: Behavior) -> dict[str, Any]:
    """Return what a behavior wants when no operator is there, as fields of a snapshot."""
    return {'operator_gone': behavior.operator_gone, 'operator_gone_after': float(behavior.operator_gone_after)}
