# SPDX-License-Identifier: BSD-3-Clause
"""Time-outs and retries for any state, as wrappers that can be nested.

``with_timeout(state, 5.0)`` ends by ``timeout`` if the state takes longer. ``with_retry(state, 3)`` leaves the state
and enters it again when it fails. Both have the keys and the outcomes of the state.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from typing import Any, Final

from flexbt_core.state_machine.model.event_state import EXIT_TIMEOUT, EventState, ExitReason
from flexbt_core.state_machine.model.state_host import Progress, StateHost
from flexbt_core.state_machine.model.userdata import StateError, UserData
from flexbt_core.values.text import short_repr

TIMEOUT: Final = 'timeout'


def with_timeout(state: EventState, seconds: float, outcome: str = TIMEOUT) -> EventState:
    """Return the state wrapped so that it is left by ``outcome`` after ``seconds``.

    Its on_exit is then called with the reason TIMED_OUT. The time counts on the state's clock, which stops while the
    state is paused. The state does not time out while the operator is asked for an outcome.

    Raises:
        StateError: the time is not positive, or ``state`` is not a state (a machine is not one).
    """
    return _Timeout(state, seconds, outcome)


def with_retry(
    state: EventState, attempts: int, on: Collection[str] = ('failed',), *, delay: float = 0.0
) -> EventState:
    """Return the state wrapped so that an outcome in ``on`` enters it again, up to ``attempts`` attempts in total.

    Before each retry its on_exit is called with the reason REPEATED, it halts, and ``delay`` seconds pass. If it
    does not halt, it is left by its outcome. Exceptions of the state are faults and cause no retry.

    Raises:
        StateError: ``attempts`` is too small, ``on`` holds a text that is not an outcome of the state, or ``state``
        is not a state.
    """
    return RetryingState(state, attempts, on, delay)


class StateWrapper(EventState):
    """A state around another one, with the same properties. Each callback is forwarded to the inner state."""

    def __init__(self, inner: EventState, extra_outcomes: Collection[str] = ()) -> None:
        given: Any = inner
        if not isinstance(given, EventState):
            raise StateError(f'only a state can have a time-out or further attempts, not {short_repr(given)}')
        self.inner = inner
        super().__init__(
            (*inner.outcomes, *extra_outcomes), inner.input_keys, inner.output_keys, desired_rate=inner.desired_rate
        )
        self.exit_reason = None

    @property
    def desired_rate(self) -> float | None:
        return self.inner.desired_rate  # which a state may change at any time

    @desired_rate.setter
    def desired_rate(self, rate: float | None) -> None:
        self.inner.desired_rate = rate

    @property
    def runs_while_blocked(self) -> bool:  # type: ignore[override]
        return self.inner.runs_while_blocked

    @property
    def unwrapped(self) -> EventState:
        return self.inner.unwrapped

    @property
    def time_limit(self) -> float:
        """Time limit of one attempt of the innermost state in s; infinity for none."""
        return self.inner.time_limit if isinstance(self.inner, StateWrapper) else math.inf

    @property
    def made_with(self) -> Mapping[str, str]:
        return {**super().made_with, **self.inner.made_with}

    @property
    def type_name(self) -> str:
        return self.inner.type_name

    def on_start(self) -> None:
        self.inner.on_start()

    def on_enter(self, userdata: UserData) -> None:
        self._enter_inner(userdata, is_resumed=self.is_resumed)

    def execute(self, userdata: UserData) -> str | None:
        return self._execute_inner(userdata)

    def on_exit(self, userdata: UserData) -> None:
        self._leave_inner(userdata, self.exit_reason)

    def on_pause(self) -> None:
        self.inner.on_pause()

    def on_resume(self, userdata: UserData) -> None:
        self.inner.on_resume(userdata)

    def on_stop(self) -> None:
        self.inner.on_stop()

    def halting(self) -> str | None:
        return self.inner.halting()

    def activity(self) -> Sequence[str]:
        return self.inner.activity()

    def progress(self) -> Progress | None:
        return self.inner.progress()

    def not_paused(self) -> Sequence[str]:
        return self.inner.not_paused()

    def _enter_inner(self, userdata: UserData, *, is_resumed: bool = False) -> None:
        self.inner.exit_reason = None
        self.inner.is_resumed = is_resumed
        self.inner.on_enter(userdata)

    def _execute_inner(self, userdata: UserData) -> str | None:
        outcome = self.inner.execute(userdata)
        if isinstance(outcome, str) and outcome not in self.inner.outcomes:
            known = ', '.join(self.inner.outcomes)
            raise StateError(f'{self.path}: execute returned {outcome!r}, which is none of its outcomes {known}')
        return outcome

    def _leave_inner(self, userdata: UserData, reason: ExitReason | None) -> None:
        self.inner.exit_reason = reason
        self.inner.on_exit(userdata)

    # The innermost state is bound to the run: it wakes, logs and asks as if nothing were around it.

    @property
    def bound_to(self) -> StateHost | None:
        return self.inner.bound_to

    def bind(self, host: StateHost | None) -> None:
        self.inner.bind(host)


class _Timeout(StateWrapper):
    def __init__(self, inner: EventState, seconds: float, outcome: str) -> None:
        super().__init__(inner, [outcome])
        if not seconds > 0.0:
            raise StateError(f'{inner.type_name}: a time-out has to be positive, not {seconds} s')
        self._seconds = seconds
        self._outcome = outcome
        self._until = 0.0
        self._is_over = False

    @property
    def type_name(self) -> str:
        return f'{self.inner.type_name}, at most {self._seconds:g} s'

    @property
    def time_limit(self) -> float:
        return min(self._seconds, super().time_limit)

    def on_enter(self, userdata: UserData) -> None:
        self._is_over = False
        self._until = self.clock.now() + self._seconds
        self.wake_at(self._until)
        super().on_enter(userdata)

    def execute(self, userdata: UserData) -> str | None:
        outcome = super().execute(userdata)
        self._is_over = outcome is None and self.clock.now() >= self._until
        return self._outcome if self._is_over else outcome

    def on_exit(self, userdata: UserData) -> None:
        is_timed_out = self._is_over and self.exit_reason in (ExitReason.OUTCOME, ExitReason.REPEATED)
        self._leave_inner(userdata, ExitReason.TIMED_OUT if is_timed_out else self.exit_reason)


class RetryingState(StateWrapper):
    """A state that is entered again when it fails: see :func:`with_retry`."""

    def __init__(self, inner: EventState, attempts: int, on: Collection[str], delay: float) -> None:
        super().__init__(inner)
        unknown = [outcome for outcome in on if outcome not in inner.outcomes]
        if attempts < 1 or unknown or not delay >= 0.0:
            problem = f'{unknown[0]!r} is none of its outcomes' if unknown else f'{attempts} attempts, delay {delay} s'
            raise StateError(f'{inner.type_name}: cannot be tried again: {problem}')
        self._attempts = attempts
        self._on = frozenset(on)
        self._delay = delay
        self._attempt = 1
        self._failed_by: str | None = None  # between two attempts
        self._next_at = 0.0
        self._rest_until = 0.0

    @property
    def type_name(self) -> str:
        return f'{self.inner.type_name}, up to {self._attempts} times'

    def activity(self) -> Sequence[str]:
        own = [f'attempt {self._attempt} of {self._attempts}'] if self._attempt > 1 else []
        return [*own, *self.inner.activity()]

    def on_enter(self, userdata: UserData) -> None:
        self._attempt, self._failed_by = 1, None
        super().on_enter(userdata)

    def execute(self, userdata: UserData) -> str | None:
        if self._failed_by is not None:
            return self._go_on(userdata, self._failed_by)
        outcome = super().execute(userdata)
        if outcome not in self._on or self._attempt >= self._attempts:
            return outcome
        assert outcome is not None  # since it is in ``on``
        self._failed_by = outcome
        self._next_at = self.clock.now() + self._delay
        self._rest_until = self.clock.now() + EXIT_TIMEOUT
        self._leave_inner(userdata, ExitReason.REPEATED)
        return self._go_on(userdata, outcome)

    def on_exit(self, userdata: UserData) -> None:
        if self._failed_by is None:
            super().on_exit(userdata)

    def on_pause(self) -> None:
        if self._failed_by is None:
            super().on_pause()

    def on_resume(self, userdata: UserData) -> None:
        if self._failed_by is None:
            super().on_resume(userdata)

    def _go_on(self, userdata: UserData, failed_by: str) -> str | None:
        """Begin the next attempt once its time has come and the state has halted."""
        now = self.clock.now()
        halting = self.halting()
        if halting is not None and now >= self._rest_until:
            self.log_error(f'is not tried again, since it had not halted after {EXIT_TIMEOUT:g} s: {halting}')
            return failed_by
        if halting is not None or now < self._next_at:
            self.wake_at(self._rest_until if halting is not None else self._next_at)
            return None
        self._failed_by = None
        self._attempt += 1
        self.log_info(f'left by {failed_by!r}; attempt {self._attempt} of {self._attempts}')
        self._enter_inner(userdata)
        self._bound().execute_again()  # so that a loop of instant attempts counts as a livelock
        return None
