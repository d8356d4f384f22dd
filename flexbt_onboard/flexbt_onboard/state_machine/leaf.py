# SPDX-License-Identifier: BSD-3-Clause
"""A state in a run: its callbacks in their order, each guarded."""

from __future__ import annotations

import heapq
import traceback
from collections.abc import Callable
from enum import Enum
from typing import TYPE_CHECKING, Any, Final, Literal, TypeVar

from flexbt_common.clock import Clock

from .definition import StateDefinition
from .errors import StateError
from .event_state import EventState, ExitReason, Severity, set_called_state
from .userdata import Scope, UserData

if TYPE_CHECKING:
    from .run import MachineRun

FAILED: Final = 'failed'
"""Outcome by which a state that raised is left, when it declares it."""

_Result = TypeVar('_Result')


class _Raised(Enum):
    """What a guarded callback gives when it raised."""

    RAISED = 'raised'


class LeafRun:
    """One state for the length of a run; entered and left any number of times.

    ``outcome`` is what the state wants to be left by, ``question`` what it asks the operator: prompt and suggestion.
    All methods but :meth:`wake` are for the thread of the run.
    """

    def __init__(self, engine: MachineRun, definition: StateDefinition) -> None:
        self._engine = engine
        self.definition = definition
        self.path = definition.path
        self.state: EventState = definition.state
        self.outcome: str | None = None
        self.exit_reason = ExitReason.OUTCOME
        self.entered_at = 0.0
        self.question: tuple[str, str | None] | None = None
        self._input_keys = frozenset(self.state.input_keys)
        self._output_keys = frozenset(self.state.output_keys)
        self._userdata: UserData | None = None
        self._woken = False
        self._wake_times: list[float] = []
        self._next_poll: float | None = None
        self._is_active = False
        self._never_settled: str | None = None

    # -- what the state uses -----------------------------------------------------------------------------------------

    @property
    def clock(self) -> Clock:
        """The clock of the run."""
        return self._engine.clock

    @property
    def services(self) -> Any:
        """What the host provides."""
        return self._engine.services

    def wake(self) -> None:
        """Execute the state soon; from any thread."""
        self._woken = True
        self._engine.ring()

    def wake_at(self, time: float) -> None:
        """Execute the state at a time, too."""
        if time not in self._wake_times:
            heapq.heappush(self._wake_times, time)

    def ask(self, prompt: str, suggestion: str | None) -> None:
        """Let the operator choose."""
        self.question = (prompt, suggestion)

    def log(self, severity: Severity, text: str) -> None:
        """Tell the operator something."""
        self._engine.observer.log(severity, self.path, text)

    # -- the life of the state ---------------------------------------------------------------------------------------

    def bind(self) -> None:
        """Take the state for this run.

        Raises:
            StateError: another run has it.
        """
        if self.state._leaf is not None:
            raise StateError(
                f'{self.path}: the state is part of a run that has not ended; define a machine for each run'
            )
        self.state._leaf = self

    def start(self) -> None:
        """Before the run."""
        if self._guarded('on_start', self.state.on_start) is _Raised.RAISED:
            self._engine.abort(f'{self.path} raised in on_start')

    def stop(self) -> None:
        """After the run, once."""
        if self.state._leaf is self:
            try:
                self._guarded('on_stop', self.state.on_stop)
            finally:
                self.state._leaf = None

    def enter(self, scope: Scope) -> None:
        """The state becomes active."""
        self._userdata = UserData(scope, self._input_keys, self._output_keys, self.definition.remap, self.path)
        self.outcome = None
        self.exit_reason = ExitReason.OUTCOME
        self.question = None
        self.entered_at = self.clock.now()
        self._wake_times.clear()
        self._woken = True  # executed at once after it was entered
        self._never_settled = None
        self._is_active = True
        self.state.exit_reason = None
        self._engine.changed()  # already now, since on_enter may take long
        if self._guarded('on_enter', self.state.on_enter, self._userdata) is _Raised.RAISED:
            self._fail()

    def advance(self) -> bool:
        """Execute the state if there is a reason to; whether it wants something now."""
        if self.outcome is not None or self.question is not None or not self._is_due():
            return False
        outcome = self._guarded('execute', self._execute)
        if outcome is _Raised.RAISED:
            self._fail()
        else:
            self.outcome = outcome
        return self.outcome is not None or self.question is not None

    def leave(self, reason: ExitReason) -> None:
        """Call on_exit, once for each time the state was entered.

        A state that raises here fails if it is left by an outcome of its own; what others decided stands.
        """
        if not self._is_active:
            return
        self._is_active = False
        self.state.exit_reason = reason
        raised = self._guarded('on_exit', self.state.on_exit, self._userdata) is _Raised.RAISED
        if raised and reason is ExitReason.OUTCOME:
            self._fail()

    def unsettled(self) -> str | None:
        """What the state that was left has not finished yet. One that raised is not asked again: nobody knows."""
        if self._never_settled is not None:
            return self._never_settled
        unsettled = self._guarded('settled', self.state.settled)
        if unsettled is _Raised.RAISED:
            unsettled = self._never_settled = 'settled() raised'
        return unsettled

    def next_wake(self) -> float | None:
        """When it is to be executed next, apart from wake-ups."""
        if self.outcome is not None or self.question is not None:
            return None
        due = self._wake_times[0] if self._wake_times else None
        if due is None or (self._next_poll is not None and self._next_poll < due):
            return self._next_poll
        return due

    def _is_due(self) -> bool:
        """Whether there is a reason to execute the state, which is taken by that."""
        now = self._engine.clock.now()
        due = self.next_wake()
        if not self._woken and (due is None or due > now):
            return False
        self._woken = False
        while self._wake_times and self._wake_times[0] <= now:
            heapq.heappop(self._wake_times)
        rate = self.state.desired_rate
        self._next_poll = None if rate is None else now + 1.0 / rate
        return True

    def _execute(self) -> str | None:
        state = self.state
        assert self._userdata is not None  # made by enter
        outcome = state.execute(self._userdata)
        if outcome is not None and (not isinstance(outcome, str) or outcome not in state.outcomes):
            raise StateError(
                f'{self.path}: execute returned {outcome!r}, which is none of its outcomes {", ".join(state.outcomes)}'
            )
        return outcome

    def _fail(self) -> None:
        self.exit_reason = ExitReason.FAULT
        self.outcome = FAILED if FAILED in self.state.outcomes else None
        if self.outcome is None:
            self._engine.abort(f'{self.path} raised, and has no outcome {FAILED!r} to leave by')

    def _guarded(
        self, what: str, callback: Callable[..., _Result], *arguments: object
    ) -> _Result | Literal[_Raised.RAISED]:
        """What a callback of the state gives."""
        set_called_state(self.state)
        try:
            return callback(*arguments)
        except Exception:  # code of the state: its trace goes to the operator
            self._engine.fault(self.path, f'{what} raised:\n{traceback.format_exc()}')
            return _Raised.RAISED
