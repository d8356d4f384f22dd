# SPDX-License-Identifier: BSD-3-Clause
"""The action goal that a state works on: sent when the state is entered, gone when it has been left."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, Final

from flexbt_common.calls import ActionCall, ActionServerLink, GoalOutcome, GoalStatus
from flexbt_core.clock import Clock, Timer
from flexbt_core.state_machine import EventState, UserData
from flexbt_onboard.behaviors import READY_SECONDS, state_services

from .parameter_checks import checked_type

SERVER_SECONDS: Final = 1.0
"""How long a server is waited for when all nodes that are alive are ready, s of wall time."""

_ENDED: Final = frozenset(
    (GoalStatus.SUCCEEDED, GoalStatus.ABORTED, GoalStatus.CANCELED, GoalStatus.REJECTED, GoalStatus.NO_SERVER)
)
"""Ends of a goal after which it is certain that nobody works on it."""


class GoalCall:
    """One goal at a time on one action server, on behalf of a state.

    The state is woken when the goal is done or its time is up. A goal that is still active when the state is left is
    canceled, and the state has not halted before that is confirmed, or the server is gone. ``not_paused`` says why the
    goal goes on while the state is paused, or what of it does; nothing if it does not.
    """

    def __init__(
        self,
        state: EventState,
        action_type: type[Any],
        topic: str,
        not_paused: Callable[[], Sequence[str]] = lambda: ('its action has no pause',),
    ) -> None:
        self._state = state
        self._action_type = action_type
        self._topic = topic
        self._not_paused = not_paused
        self._link: ActionServerLink | None = None
        self._call: ActionCall | None = None
        self._last: ActionCall | None = None
        self._outcome: GoalOutcome | None = None
        self._unfinished: list[ActionCall] = []
        self._timer: Timer | None = None
        self._clock: Clock | None = None
        self._deadline: float | None = None
        self._timeout: float | None = None

    @property
    def goal_id(self) -> str:
        """ID of the goal that is worked on, hexadecimal; '' while there is none."""
        return '' if self._call is None else self._call.goal_id.hex()

    @property
    def is_over(self) -> bool:
        """Whether it is certain that nobody works on the goal that was sent last."""
        outcome = None if self._last is None else self._last.outcome
        return outcome is not None and outcome.status in _ENDED

    @property
    def last_result(self) -> Any:
        """What the server has given for the goal that was sent last; None when it gave nothing, or has not yet."""
        outcome = None if self._last is None else self._last.outcome
        return None if outcome is None else outcome.result

    def prepare(self) -> None:
        """Look for the server already: called when the run starts, so that discovery is over when the goal is sent."""
        if self._link is None:
            self._link = state_services(self._state).actions.link(self._action_type, self._topic)

    def send(
        self,
        goal: Any,
        *,
        timeout: float | None = None,
        clock: Clock | None = None,
        on_feedback: Callable[[Any], None] | None = None,
    ) -> None:
        """Send a goal. Its result has to come within ``timeout`` seconds on ``clock`` (default: wall time)."""
        self.prepare()
        assert self._link is not None
        self._outcome = None
        self._timeout = timeout
        if timeout is not None:
            self._clock = clock or state_services(self._state).runtime.steady
            self._deadline = self._clock.now() + timeout
            self._timer = self._clock.call_at(self._deadline, self._state.wake)
        services = state_services(self._state)
        # A server of a node that is about to be ready will be there.
        patience = READY_SECONDS if services.unready() else SERVER_SECONDS
        self._call = self._last = ActionCall(
            self._link, goal, on_done=self._on_done, on_feedback=on_feedback, server_timeout=patience
        )
        services.goals.add(self._state, self._topic, self._call, self._not_paused)

    def poll(self) -> GoalOutcome | None:
        """The outcome, or None while the goal is worked on. When its time is up the goal is canceled."""
        call = self._call
        if call is None:
            return self._outcome
        if call.done:
            self._outcome = call.outcome
        elif self._deadline is not None and self._clock is not None and self._clock.now() >= self._deadline:
            self._outcome = GoalOutcome(
                GoalStatus.TIMEOUT,
                None,
                f'{self._topic} gave no result within {self._timeout:g} s; the goal was canceled',
            )
        else:
            return None
        self.leave()
        return self._outcome

    def leave(self) -> None:
        """Give the goal up: it is canceled when it is not done."""
        if self._timer is not None:
            self._timer.cancel()
        self._timer = self._deadline = None
        call, self._call = self._call, None
        if call is not None and not call.done:
            self._unfinished.append(call)
            call.cancel(None)

    def halting(self) -> str | None:
        """What has not halted yet: a goal whose end nobody has confirmed. None when there is none."""
        for call in [call for call in self._unfinished if call.done]:
            self._unfinished.remove(call)
            if call.outcome is not None and call.outcome.status not in _ENDED:
                self._state.log_warn(f'it is not known whether the goal has ended: {call.outcome.reason}')
        return f'goal of {self._topic} not confirmed canceled' if self._unfinished else None

    def _on_done(self, outcome: GoalOutcome) -> None:
        self._state.wake()


class GoalState(EventState):
    """A state that works on one action goal, which it makes as ``_goal`` and sends when it is entered."""

    _goal: GoalCall

    def _checked_type(self, parameter: str, name: str, package: str = '') -> str:
        """The type that a parameter names; see :func:`checked_type`."""
        return checked_type(self, parameter, name, package)

    def on_start(self) -> None:
        self._goal.prepare()

    def on_exit(self, userdata: UserData) -> None:
        self._goal.leave()

    def halting(self) -> str | None:
        return self._goal.halting()
