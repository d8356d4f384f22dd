# SPDX-License-Identifier: BSD-3-Clause
"""A state in a run: its callbacks in their order, each guarded."""

from __future__ import annotations

import traceback
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from flexbt_common.clock import Clock

from .definition import StateDefinition
from .event_state import EventState, ExitReason, Severity
from .userdata import Scope, UserData

if TYPE_CHECKING:
    from .run import MachineRun

FAILED = 'failed'
"""Outcome by which a state that raised is left, when it declares it."""


class LeafRun:
    """One state for the length of a run; entered and left any number of times.

    ``outcome`` is what the state wants to be left by. All methods but :meth:`wake` are for the thread of the run.
    """

    def __init__(self, engine: MachineRun, definition: StateDefinition) -> None:
        self._engine = engine
        self.definition = definition
        self.path = definition.path
        self.state: EventState = definition.state
        self.state._leaf = self
        self.outcome: str | None = None
        self.exit_reason = ExitReason.OUTCOME
        self.entered_at = 0.0
        self.question: tuple[str, str | None] | None = None
        self._userdata: UserData | None = None
        self._woken = False
        self._wake_time: float | None = None
        self._next_poll: float | None = None
        self._is_active = False

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
        self._wake_time = time

    def ask(self, prompt: str, suggestion: str | None) -> None:
        """Let the operator choose."""
        self.question = (prompt, suggestion)

    def log(self, severity: Severity, text: str) -> None:
        """Tell the operator something."""
        self._engine.observer.log(severity, self.path, text)

    # -- the life of the state ---------------------------------------------------------------------------------------

    def start(self) -> None:
        """Before the run."""
        self._guarded('on_start', self.state.on_start)

    def stop(self) -> None:
        """After the run."""
        self._guarded('on_stop', self.state.on_stop)
        self.state._leaf = None

    def enter(self, scope: Scope) -> None:
        """The state becomes active."""
        state, definition = self.state, self.definition
        self._userdata = UserData(
            scope, frozenset(state.input_keys), frozenset(state.output_keys), definition.remap, definition.path
        )
        self.outcome = None
        self.exit_reason = ExitReason.OUTCOME
        self.question = None
        self.entered_at = self.clock.now()
        self._wake_time = None
        self._next_poll = None
        self._woken = True  # executed at once after it was entered
        self._is_active = True
        state.exit_reason = None
        userdata = self._userdata
        if not self._guarded('on_enter', lambda: state.on_enter(userdata)):
            self._fail()

    def advance(self) -> bool:
        """Execute the state if there is a reason to; whether anything has happened."""
        if self.outcome is not None or self.question is not None:
            return False
        now = self.clock.now()
        if not self._is_due(now):
            return False
        self._woken = False
        self._wake_time = None
        rate = self.state.desired_rate
        self._next_poll = None if rate is None else now + 1.0 / rate
        userdata = self._userdata
        assert userdata is not None  # made by enter
        answers: list[str | None] = []
        if not self._guarded('execute', lambda: answers.append(self.state.execute(userdata))):
            self._fail()
        elif answers[0] is not None and answers[0] not in self.state.outcomes:
            self._engine.fault(
                self.path,
                f'execute returned {answers[0]!r}, which is none of its outcomes {", ".join(self.state.outcomes)}',
            )
            self._fail()
        else:
            self.outcome = answers[0]
        return self.outcome is not None or self.question is not None

    def leave(self, reason: ExitReason) -> None:
        """Call on_exit, once for each time the state was entered."""
        if not self._is_active:
            return
        self._is_active = False
        self.state.exit_reason = reason if self.exit_reason is ExitReason.OUTCOME else self.exit_reason
        userdata = self._userdata
        assert userdata is not None  # made by enter
        self._guarded('on_exit', lambda: self.state.on_exit(userdata))

    def unsettled(self) -> str | None:
        """What the state that was left has not finished yet."""
        what: list[str | None] = [None]

        def ask() -> None:
            what[0] = self.state.settled()

        self._guarded('settled', ask)
        return what[0]

    def next_wake(self) -> float | None:
        """When it is to be executed next, apart from wake-ups."""
        if self.outcome is not None or self.question is not None:
            return None
        times = [time for time in (self._wake_time, self._next_poll) if time is not None]
        return min(times, default=None)

    def _is_due(self, now: float) -> bool:
        if self._woken:
            return True
        time = self.next_wake()
        return time is not None and time <= now

    def _fail(self) -> None:
        self.exit_reason = ExitReason.FAULT
        self.question = None
        if FAILED in self.state.outcomes:
            self.outcome = FAILED
        else:
            self._engine.abort(f'{self.path} raised, and has no outcome {FAILED!r} to leave by')

    def _guarded(self, what: str, callback: Callable[[], object]) -> bool:
        """Call a callback; whether it came back without an exception."""
        try:
            callback()
        except Exception:  # code of the state: its trace goes to the operator
            self._engine.fault(self.path, f'{what} raised:\n{traceback.format_exc()}')
            return False
        return True
