# SPDX-License-Identifier: BSD-3-Clause
"""A state in a run: calls its callbacks in order, and turns their exceptions into faults."""

from __future__ import annotations

import heapq
import math
import traceback
from collections.abc import Callable, Iterable
from enum import Enum
from typing import Any, Final, Literal, TypeVar

from flexbt_core.state_machine.model.definition import StateDefinition
from flexbt_core.state_machine.model.event_state import EventState, ExitReason, set_called_state
from flexbt_core.state_machine.model.state_host import Progress, Severity, StateClock
from flexbt_core.state_machine.model.userdata import Scope, StateError, UserData

from .engine import Engine
from .events import Faulted, Logged, StateEntered, StateExited, StatePaused

FAILED: Final = 'failed'
"""Outcome by which a state that raised is left, if it declares it."""

_Result = TypeVar('_Result')


class _Raised(Enum):
    """The result of a guarded callback that raised."""

    RAISED = 'raised'


class LeafRun:
    """The host of one state during a run; the state is entered and left any number of times.

    ``outcome`` is the outcome that the state wants to be left by. ``choice`` is the prompt and the suggestion of a
    question to the operator. ``is_entered`` is true until ``on_exit`` is called. Call all methods except :meth:`wake`
    on the thread of the run. What FlexBE's states do not have, such as ``progress``, is called by their class: they may
    have attributes of these names.
    """

    def __init__(self, engine: Engine, definition: StateDefinition) -> None:
        self._engine = engine
        self.definition = definition
        self.path = definition.path
        self.state: EventState = definition.state
        self.outcome: str | None = None
        self.exit_reason = ExitReason.OUTCOME
        self.entered_at = 0.0
        """Time at which the state was entered, on the clock of the run, s."""
        self.is_entered = False
        self.is_paused = False
        self.clock = StateClock(engine.clock)
        self.choice: tuple[str, str | None] | None = None
        self._input_keys = frozenset(self.state.input_keys)
        self._output_keys = frozenset(self.state.output_keys)
        self._userdata: UserData | None = None
        self._woken = False
        self._is_again = False  # to be executed again in this step
        self._wake_times: list[float] = []
        self._next_poll: float | None = None
        self._successor: EventState | None = None  # replaces the state at its next entry
        self._never_halted: str | None = None

    # -- for the state ----------------------------------------------------------------------------------------------

    @property
    def services(self) -> Any:
        """Services of the host."""
        return self._engine.services

    def wake(self) -> None:
        """Execute the state soon. Callable from any thread."""
        self._woken = True
        self._engine.wake()

    def wake_at(self, time: float) -> None:
        """Execute the state also at ``time``, in s of its clock. Raises StateError if that is NaN."""
        if math.isnan(time):
            raise StateError(f'{self.path}: a state cannot be woken at the time nan; give seconds of its clock')
        if time not in self._wake_times:
            heapq.heappush(self._wake_times, time)

    def execute_again(self) -> None:
        """Execute the state again: in this step, unless :meth:`Engine.goes_on` ends it."""
        self._is_again = self._engine.goes_on()
        self.wake()

    def ask(self, prompt: str, suggestion: str | None) -> None:
        """Let the operator choose."""
        self.choice = (prompt, suggestion)

    def log(self, severity: Severity, text: str) -> None:
        """Log a line for the operator."""
        self._engine.tell(Logged(severity, self.path, text))

    # -- the life of the state ---------------------------------------------------------------------------------------

    def check_free(self) -> None:
        """Check that no other run has the state.

        Raises:
            StateError: the state is part of another run.
        """
        if self.state.bound_to is not None:
            raise StateError(
                f'{self.path}: the state is part of a run that has not ended; define a machine for each run'
            )

    def bind(self) -> None:
        """Bind the state to this run."""
        self.state.bind(self)

    def start(self) -> bool:
        """Call on_start of the state before the run. Return whether it raised."""
        return self.call('on_start', self.state.on_start) is _Raised.RAISED

    def stop(self) -> None:
        """Call on_stop after the run, once for each state that was started here."""
        for state in (self.state, self._successor):
            if state is not None:
                self._retire(state)

    def stay(self, definition: StateDefinition) -> None:
        """Move to another machine. ``definition.state``, already started, replaces the state at its next entry."""
        if self._successor is not None:
            self._retire(self._successor)
        self.definition = definition
        self._successor = definition.state
        self._successor.bind(self)

    def move(self, scope: Scope) -> None:
        """Use the userdata of a machine."""
        if self._userdata is None or self._userdata._scope is not scope:
            self._userdata = UserData(scope, self._input_keys, self._output_keys, self.definition.remap, self)

    def restore(self, scope: Scope, outcome: str) -> None:
        """Wait again to be left by an outcome, as in the interrupted run, without entering the state."""
        self.move(scope)
        self._begin()
        self.outcome = outcome

    def enter(self, scope: Scope, *, is_resumed: bool = False) -> None:
        """Enter the state."""
        if self._successor is not None:
            self._retire(self.state)
            self.state, self._successor = self._successor, None
        self.move(scope)
        self._begin()
        self._woken = True  # execute at once after on_enter
        self.is_entered = True
        self.state.exit_reason = None
        self.state.is_resumed = is_resumed
        self._engine.tell(StateEntered(self.path))  # report it first, since on_enter may take long
        if self.call('on_enter', self.state.on_enter, self._userdata) is _Raised.RAISED:
            self._fail()

    def advance(self) -> bool:
        """Execute the state if it is due. Return whether it wants an outcome, a choice or another execution, or
        raised."""
        if not self._is_running or not self._is_due():
            return False
        self._is_again = False
        outcome = self.call('execute', self._execute)
        if outcome is _Raised.RAISED:
            self._fail()
            return True  # the fault may end the run, so nothing else may begin first
        self.outcome = outcome
        return self.outcome is not None or self.choice is not None or self._is_again

    def leave(self, reason: ExitReason) -> None:
        """Call on_exit, once for each time the state was entered.

        If on_exit raises, a state that is left by its own outcome fails; for other reasons the transition stands.
        """
        if not self.is_entered:
            return
        self.is_entered = False
        if self.is_paused:
            self.is_paused = False
            self.clock.go_on()  # its last work may need time
            self._engine.tell(StatePaused(self.path, False))
        self.state.exit_reason = reason
        if self._engine.readings[StateExited]:
            self._engine.tell(StateExited(self.path))
        raised = self.call('on_exit', self.state.on_exit, self._userdata) is _Raised.RAISED
        if raised and reason is ExitReason.OUTCOME:
            self._fail()

    def pause(self) -> None:
        """Pause the state: stop its clock and do not execute it until it is resumed."""
        self.is_paused = True
        self.clock.stop()
        if self.call('on_pause', self.state.on_pause) is _Raised.RAISED:
            self._fail()

    def resume(self) -> None:
        """Resume the state."""
        self.is_paused = False
        self.clock.go_on()
        self._woken = True
        if self.call('on_resume', self.state.on_resume, self._userdata) is _Raised.RAISED:
            self._fail()

    def halting(self) -> str | None:
        """Return the work of the left state that has not halted yet, or None. If this raises, the state is not
        asked again: the answer is unknown."""
        if self._never_halted is not None:
            return self._never_halted
        if type(self.state).halting is EventState.halting:  # most states have nothing to wait for
            return None
        halting = self.call('halting', type(self.state).halting, self.state)
        if halting is _Raised.RAISED:
            halting = self._never_halted = 'halting() raised'
        return halting

    def activity(self) -> list[str] | None:
        """Return the activity that the state reports; None if it raised."""
        return self._lines('activity', type(self.state).activity)

    def progress(self) -> Progress | None:
        """Return the progress that the state reports; None if it has none or raised."""
        progress = self.call('progress', type(self.state).progress, self.state)
        return progress if isinstance(progress, Progress) else None

    def not_paused(self) -> list[str] | None:
        """Return the work that continues while the state is paused, as it reports it; None if it raised."""
        return self._lines('not_paused', type(self.state).not_paused) if self.is_paused else []

    def next_wake(self) -> float | None:
        """Return the time of the next execution without a wake-up, on the run's clock."""
        due = self._due()
        return None if due is None or self.is_paused or not self._is_running else self.clock.on_base(due)

    @property
    def _is_running(self) -> bool:
        """True if the state is executed: it is not frozen until a decision of the operator."""
        return self.choice is None and (self.outcome is None or self.runs_while_blocked)

    @property
    def runs_while_blocked(self) -> bool:
        """True if the state is executed while it waits to be left by an outcome."""
        return self.state.runs_while_blocked and self.exit_reason is ExitReason.OUTCOME and self.is_entered

    def _begin(self) -> None:
        self.outcome = None
        self.exit_reason = ExitReason.OUTCOME
        self.choice = None
        self.entered_at = self._engine.clock.now()
        if self.clock.is_behind:
            self.clock.catch_up()
        self._wake_times.clear()
        self._never_halted = None

    def _due(self) -> float | None:
        due = self._wake_times[0] if self._wake_times else None
        if due is None or (self._next_poll is not None and self._next_poll < due):
            return self._next_poll
        return due

    def _is_due(self) -> bool:
        """Return whether the state is due, and clear the reason."""
        if not self._woken:
            due = self._due()
            if due is None or due > self.clock.now():
                return False
        self._woken = False
        if self._wake_times:
            now = self.clock.now()
            while self._wake_times and self._wake_times[0] <= now:
                heapq.heappop(self._wake_times)
        return True

    def _execute(self) -> str | None:
        state = self.state
        assert self._userdata is not None  # made by enter
        rate = state.desired_rate
        if rate is not None and not rate > 0:
            raise StateError(f'{self.path}: desired_rate has to be positive, or None, not {rate}')
        self._next_poll = None if rate is None else self.clock.now() + 1.0 / rate
        outcome = state.execute(self._userdata)
        if outcome is not None and (not isinstance(outcome, str) or outcome not in state.outcomes):
            raise StateError(
                f'{self.path}: execute returned {outcome!r}, which is none of its outcomes {", ".join(state.outcomes)}'
            )
        return outcome

    def _lines(self, what: str, callback: Callable[[EventState], Iterable[object]]) -> list[str] | None:
        lines = self.call(what, lambda: [str(line) for line in callback(self.state)])
        return None if lines is _Raised.RAISED else lines

    def _fail(self) -> None:
        self.exit_reason = ExitReason.FAULT
        self.choice = None
        self.outcome = FAILED if FAILED in self.state.outcomes else None
        if self.outcome is None:
            self._engine.fail(f'{self.path} raised, and has no outcome {FAILED!r} to leave by')

    def _retire(self, state: EventState) -> None:
        """Call on_stop of a state and unbind it."""
        if state.bound_to is self:
            try:
                self.call('on_stop', state.on_stop)
            finally:
                state.bind(None)

    def call(
        self, what: str, callback: Callable[..., _Result], *arguments: object
    ) -> _Result | Literal[_Raised.RAISED]:
        """Call a callback of the state and return its result. The run shows the callback while it runs.

        Each callback gets new copies of what the state only reads: others may change the values themselves meanwhile.
        """
        set_called_state(self.state)
        if self._userdata is not None:
            self._userdata._copies.clear()
        engine = self._engine
        outer, engine.calling = engine.calling, (self.path, what)
        try:
            return callback(*arguments)
        except Exception:  # code of the state: its trace goes to the operator
            engine.tell(Faulted(self.path, f'{what} raised:\n{traceback.format_exc()}'))
            return _Raised.RAISED
        finally:
            engine.calling = outer
