# SPDX-License-Identifier: BSD-3-Clause
"""A bench for the state machine: scripted and counting states, and a host with a manual clock.

Like the executive, the host steps the run only after a wake-up and when it is due. A forgotten wake-up hangs the run
here.

A trace is a list of callbacks in call order: ``on_enter``, with `` resumed`` if the run resumes there; ``on_exit`` with
the name of the :class:`ExitReason`, as in ``on_exit PARENT_LEFT``; and the names of the others. The common trace of a
bench adds the path of the state: ``on_exit /Outer/Inner OUTCOME``. It omits calls of ``halting`` and ``activity``.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from functools import partialmethod
from typing import Any

from flexbt_core.clock.clock import ManualClock
from flexbt_core.clock.waiting import WakeEvent
from flexbt_core.monitors.machine_monitor import MachineMonitor
from flexbt_core.monitors.properties import Violation
from flexbt_core.state_machine.authoring.checked_definition import define
from flexbt_core.state_machine.authoring.machine import ConcurrencyContainer, OperatableStateMachine, PriorityContainer
from flexbt_core.state_machine.engine import operator_commands
from flexbt_core.state_machine.engine.engine import MAX_TRANSITIONS, RunLimits
from flexbt_core.state_machine.engine.events import (
    CommandDecided,
    Faulted,
    Logged,
    OutcomeTaken,
    RunEnding,
    RunEvent,
    RunReader,
    RunRested,
    StateExited,
    StateLeft,
)
from flexbt_core.state_machine.engine.resume import RunPosition, start_at, switch_machine
from flexbt_core.state_machine.engine.run import MachineRun
from flexbt_core.state_machine.model.autonomy import Autonomy, Decision
from flexbt_core.state_machine.model.definition import Child
from flexbt_core.state_machine.model.event_state import EventState, ExitReason, called_state
from flexbt_core.state_machine.model.state_host import Severity
from flexbt_core.state_machine.model.userdata import UserData

Do = Callable[['Scripted', Any], Any]
"""A callback of a scripted state. Its arguments are the state and its userdata (None if it has none)."""

STEPS_AT_ONCE = 50
"""Number of steps without a pause that counts as a busy loop."""


class Scripted(EventState):
    """A state that keeps a ``trace`` of its callbacks; ``do`` adds an action to each of them, by its name.

    If ``execute`` returns nothing, the state is left by ``outcome`` once it is set.
    """

    def __init__(
        self,
        *outcomes: str,
        outcome: str | None = None,
        do: Mapping[str, Do] | None = None,
        rate: float | None = None,
        input_keys: Iterable[str] = (),
        output_keys: Iterable[str] = (),
        io_keys: Iterable[str] = (),
    ) -> None:
        super().__init__(outcomes or ('done',), input_keys, output_keys, io_keys, desired_rate=rate)
        self.outcome = outcome
        self.do = dict(do or {})
        self.trace: list[str] = []
        self._calls: Counter[str] = Counter()

    def calls(self, callback: str) -> int:
        """Return the number of calls of a callback."""
        return self._calls[callback]

    def end(self, outcome: str) -> None:
        """Leave the state by an outcome, as if its event had happened."""
        self.outcome = outcome
        self.wake()

    def on_start(self) -> None:
        self._called('on_start')

    def on_enter(self, userdata: Any) -> None:
        self._called('on_enter', userdata, ' resumed' if self.is_resumed else '')

    def execute(self, userdata: Any) -> str | None:
        own = self._called('execute', userdata)
        return own if own is not None else self.outcome

    def on_exit(self, userdata: Any) -> None:
        assert self.exit_reason is not None
        self._called('on_exit', userdata, f' {self.exit_reason.name}')

    def on_pause(self) -> None:
        self._called('on_pause')

    def on_resume(self, userdata: Any) -> None:
        self._called('on_resume', userdata)

    def on_stop(self) -> None:
        self._called('on_stop')

    def halting(self) -> str | None:
        return self.do['halting'](self, None) if 'halting' in self.do else None

    def _called(self, callback: str, userdata: Any = None, detail: str = '') -> Any:
        self._calls[callback] += 1
        self.trace.append(callback + detail)
        if isinstance(self.services, Bench):
            called = called_state()  # itself, or what wraps it
            assert called is not None
            assert called is not self or self.services.run.calling == (self.path, callback)
            self.services.trace.append(f'{callback} {self.path}{detail}')
        return self.do[callback](self, userdata) if callback in self.do else None


def passing(*, outcome: str = 'done', outcomes: Iterable[str] = ('done',)) -> Scripted:
    """Return a state that finishes immediately."""
    return Scripted(*outcomes, outcome=outcome)


def machine(
    *children: Child,
    outcomes: Iterable[str] = ('ended',),
    input_keys: Iterable[str] = (),
    output_keys: Iterable[str] = (),
    io_keys: Iterable[str] = (),
    defaults: Mapping[str, Any] | None = None,
    conditions: Iterable[tuple[str, Iterable[tuple[str, str]]]] = (),
    priority: bool = False,
) -> OperatableStateMachine:
    """Return a machine of states; with ``conditions`` a concurrency container."""
    made: OperatableStateMachine
    keys = outcomes, input_keys, output_keys, io_keys
    if conditions:
        made = ConcurrencyContainer(*keys, conditions)
    else:
        made = PriorityContainer(*keys) if priority else OperatableStateMachine(*keys)
    for key, value in (defaults or {}).items():
        made.userdata[key] = value
    with made:
        for child in children:
            OperatableStateMachine.add(child.label, child.state, child.transitions, child.autonomy, child.remapping)
    return made


def nested(state: EventState, labels: str, autonomy: Mapping[str, int] | None = None) -> OperatableStateMachine:
    """Return machines around a state that forward its outcomes. ``labels`` go from outside in, as in 'A/B/C'."""
    first, _, rest = labels.partition('/')
    inner = nested(state, rest, autonomy) if rest else state
    ways = {outcome: outcome for outcome in state.outcomes}
    return machine(Child(first, inner, ways, (autonomy or {}) if not rest else {}), outcomes=state.outcomes)


@dataclass(frozen=True)
class BenchSnapshot:
    """The operator's view at some time."""

    active: tuple[str, ...]
    decisions: tuple[Decision, ...]
    paused: tuple[str, ...]
    controls: tuple[bool | str, ...]


class Bench(RunReader):
    """The host of one run, and a reader of its events.

    States use it as ``services``, and write to the common ``trace``.

    Monitors check each run; any problem fails the test.
    """

    def __init__(
        self,
        machine: OperatableStateMachine,
        *,
        autonomy: int = Autonomy.Full,
        userdata: Mapping[str, Any] | None = None,
        steady: ManualClock | None = None,
        start: bool = True,
        at: RunPosition | None = None,
        max_transitions: int = MAX_TRANSITIONS,
    ) -> None:
        self.clock = ManualClock()
        self.steady = steady or self.clock
        self.trace: list[str] = []
        self.faults: list[tuple[str, str]] = []
        self.lines: list[tuple[Severity, str, str]] = []
        self.transitions: list[tuple[str, str, str, ExitReason]] = []
        self.snapshots: list[BenchSnapshot] = []
        self.steps = 0
        self._has_changed = False
        self.answers: list[str | None] = []
        """Answers to commands: None, or the reason for a refusal."""
        self.answered: list[object] = []
        """IDs of the commands of these answers."""
        self.wake_event = WakeEvent()
        self.violations: list[Violation] = []
        self.run = MachineRun(
            define(machine),
            self.clock,
            [self],
            autonomy=autonomy,
            userdata=userdata,
            services=self,
            steady=self.steady,
            limits=RunLimits(exit_timeout=3.0, stop_timeout=10.0, transitions=max_transitions),
            wake_event=self.wake_event,
        )
        self.run.add_reader(MachineMonitor(self.run, self.violations.append))
        if start:
            if at is None:
                self.run.start()
            else:
                start_at(self.run, at)
            self.settle()

    # -- the reader --------------------------------------------------------------------------------------------------

    def read(self, event: RunEvent) -> None:
        match event:
            case Logged():
                self.lines.append((event.severity, event.path, event.text))
            case Faulted():
                self.faults.append((event.path, event.text))
            case CommandDecided():
                self.answers.append(event.refusal)
                self.answered.append(event.command_id)
            case StateLeft():
                self._has_changed = True
                self.transitions.append((event.path, event.outcome, event.target, event.reason))
            case RunRested() | RunEnding() | StateExited() | OutcomeTaken():
                pass
            case _:
                self.show()

    def show(self) -> None:
        """Take a snapshot of the operator's view."""
        self._has_changed = False
        active = self.active
        decisions = tuple(self.run.decisions)
        if decisions:
            known = {region.child.path for region in self.run.regions() if region.child is not None}
            assert known.issuperset(decision.path for decision in decisions), (decisions, known)
        paused = tuple(leaf.path for leaf in self.run.active_states() if leaf.is_paused)
        controls: tuple[bool | str, ...] = (self.run.is_paused, *self.run.locked, '', *self.run.breakpoints)
        self.snapshots.append(BenchSnapshot(active, decisions, paused, controls))

    # -- the host ----------------------------------------------------------------------------------------------------

    def settle(self) -> None:
        """Step the run until nothing wakes it any more."""
        at_once = 0
        while self.run.outcome is None and self.wake_event.take():
            self._step()
            at_once += 1
            assert at_once <= STEPS_AT_ONCE, f'busy: {self.trace[-8:]}'

    def pass_time(self, seconds: float) -> None:
        """Let time pass, and wake up exactly when something is due."""
        end = self.clock.now() + seconds
        while self.run.outcome is None:
            due, timer = self.run.next_wake, self.clock.next_timer()
            times = [time for time in (due, timer) if time is not None and time <= end]
            if not times:
                break
            self.clock.set(max(min(times), self.clock.now()))
            if due is not None and due <= self.clock.now():
                self.wake_event.set()
            self.settle()
            assert (self.run.next_wake or end + 1.0) > self.clock.now(), f'still due: {self.trace[-8:]}'
        self.clock.set(end)

    def _step(self) -> None:
        self.steps += 1
        self.run.step()
        if self._has_changed:
            self.show()
        assert not self.violations, self.violations

    # -- the operator ------------------------------------------------------------------------------------------------

    @property
    def outcome(self) -> str | None:
        """Outcome of the run."""
        return self.run.outcome

    def shown_end(self) -> tuple[str | None, str]:
        """Return the outcome, and the text about states that have not halted yet."""
        return self.run.outcome, self.run.not_halted

    @property
    def active(self) -> tuple[str, ...]:
        """Paths of the active states."""
        return tuple(leaf.path for leaf in self.run.active_states())

    @property
    def decision(self) -> Decision:
        """The only pending decision."""
        (decision,) = self.run.decisions
        return decision

    def answer_to(self, command: Callable[..., str | None], *arguments: Any) -> str | None:
        """Send a command, check that there is exactly one answer, and return the reason for a refusal."""
        self.answers.clear()
        self.run.command('', command, *arguments)
        self.settle()
        (answer,) = self.answers
        return answer

    def confirm(self, decision_id: str | None = None) -> str | None:
        """Confirm the pending decision, or one by id; return the reason for a refusal."""
        chosen = self.decision.id if decision_id is None else decision_id
        return self.answer_to(operator_commands.confirm, chosen)

    # Send a command; return the reason for a refusal.
    force = partialmethod(answer_to, operator_commands.force)
    set_autonomy = partialmethod(answer_to, operator_commands.set_autonomy)
    repeat = partialmethod(answer_to, operator_commands.repeat)
    lock = partialmethod(answer_to, operator_commands.lock)
    unlock = partialmethod(answer_to, operator_commands.unlock)
    set_breakpoint = partialmethod(answer_to, operator_commands.set_breakpoint)
    clear_breakpoint = partialmethod(answer_to, operator_commands.clear_breakpoint)
    step_by = partialmethod(answer_to, operator_commands.step)
    pause = partialmethod(answer_to, operator_commands.pause)
    resume = partialmethod(answer_to, operator_commands.resume)

    def switch(self, made: OperatableStateMachine) -> str | None:
        """Switch to another machine; return the reason for a refusal."""
        return self.answer_to(switch_machine, define(made))

    def stop(self, reason: str = 'test') -> None:
        """Preempt the run."""
        self.run.preempt(reason)
        self.settle()


# States that count an operator's confirmations in the userdata.


class Ask(EventState):
    """A state that asks to be left."""

    def __init__(self) -> None:
        super().__init__(outcomes=['again', 'out'], desired_rate=None)

    def execute(self, userdata: UserData) -> str:
        return 'again'


class Add(EventState):
    """A state that counts."""

    def __init__(self) -> None:
        super().__init__(outcomes=['done'], io_keys=['count'], desired_rate=None)

    def execute(self, userdata: UserData) -> str:
        userdata['count'] += 1
        return 'done'
