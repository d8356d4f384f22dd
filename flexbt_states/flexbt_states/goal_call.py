# SPDX-License-Identifier: BSD-3-Clause
"""The action goal of a state, sent on entry and ended on exit; its outcome; and what a state uses of the BT server."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Final, Protocol, runtime_checkable

from flexbt_common.calls.action_call import ActionCall, ActionServerLink, GoalOutcome, GoalStatus
from flexbt_common.values.entries import check_value, from_entry
from flexbt_core.clock.clock import Clock, Timer
from flexbt_core.errors import FlexbtError
from flexbt_core.state_machine.model.event_state import EventState
from flexbt_core.state_machine.model.userdata import UserData
from flexbt_msgs.action import BtExecute
from flexbt_onboard.behaviors.run_context import READY_SECONDS, StateServices, state_services

from .parameter_checks import checked_timeout, checked_topic, checked_type

SERVER_SECONDS: Final = 1.0
"""Time to wait for a server when no node is starting, s of wall time."""

_ENDED: Final = frozenset(
    (GoalStatus.SUCCEEDED, GoalStatus.ABORTED, GoalStatus.CANCELED, GoalStatus.REJECTED, GoalStatus.NO_SERVER)
)
"""Ends of a goal after which no server can still work on it."""


class GoalCall:
    """A client for one goal at a time on one action server, for a state.

    The state is woken when the goal is done or its time is up. If the goal is active when the state is left, it is
    canceled, and the state has halted only when the cancellation is confirmed or the server is gone. ``not_paused``
    returns why, or which part of, the goal continues while the state is paused; empty if none. ``services`` are those
    of the run and are kept from :meth:`prepare` on, because feedback may arrive after the run has ended.
    """

    services: StateServices

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
        self._sent: object = None
        """Identity of the last goal."""
        self._outcome: GoalOutcome | None = None
        self._unfinished: list[ActionCall] = []
        self._timer: Timer | None = None
        self._clock: Clock | None = None
        self._deadline: float | None = None
        self._timeout: float | None = None

    @property
    def goal_id(self) -> str:
        """ID of the active goal, hexadecimal; '' without one."""
        return '' if self._call is None else self._call.goal_id.hex()

    @property
    def is_over(self) -> bool:
        """True if no server can still work on the last goal."""
        outcome = None if self._last is None else self._last.outcome
        return outcome is not None and outcome.status in _ENDED

    @property
    def last_result(self) -> Any:
        """Result of the last goal; None if the server returned none, or has not yet."""
        outcome = None if self._last is None else self._last.outcome
        return None if outcome is None else outcome.result

    def prepare(self) -> None:
        """Start the discovery of the server. Call it at the start of the run, so that it is done before the goal."""
        if self._link is None:
            self.services = state_services(self._state)
            self._link = self.services.actions.link(self._action_type, self._topic)

    def send(
        self,
        goal: Any,
        *,
        timeout: float | None = None,
        clock: Clock | None = None,
        on_feedback: Callable[[Any], None] | None = None,
    ) -> None:
        """Send a goal. Its result must arrive within ``timeout`` seconds on ``clock`` (default: wall time).
        ``on_feedback`` gets the feedback on this goal until another one is sent."""
        self.prepare()
        assert self._link is not None
        self._outcome = None
        self._timeout = timeout
        if timeout is not None:
            self._clock = clock or self.services.runtime.steady
            self._deadline = self._clock.now() + timeout
            self._timer = self._clock.call_at(self._deadline, self._state.wake)
        patience = READY_SECONDS if self.services.starting() else SERVER_SECONDS
        sent = self._sent = object()

        def hear(feedback: Any) -> None:
            if on_feedback is not None and self._sent is sent:  # an earlier goal goes on until its cancel takes effect
                on_feedback(feedback)

        self._call = self._last = ActionCall(
            self._link, goal, on_done=self._on_done, on_feedback=hear, server_timeout=patience
        )
        self.services.goals.add(self._state, self._topic, self._call, self._not_paused)

    def poll(self) -> GoalOutcome | None:
        """Return the outcome, or None while the goal is active. Cancel the goal when its time is up."""
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
        """Cancel the goal unless it is done."""
        if self._timer is not None:
            self._timer.cancel()
        self._timer = self._deadline = None
        call, self._call = self._call, None
        if call is not None and not call.done:
            self._unfinished.append(call)
            call.cancel(None)

    def halting(self) -> str | None:
        """Return a text about a goal whose end is not confirmed yet; None if it has halted."""
        for call in [call for call in self._unfinished if call.done]:
            self._unfinished.remove(call)
            if call.outcome is not None and call.outcome.status not in _ENDED:
                self._state.log_warn(f'it is not known whether the goal has ended: {call.outcome.reason}')
        return f'goal of {self._topic} not confirmed canceled' if self._unfinished else None

    def _on_done(self, outcome: GoalOutcome) -> None:
        self._state.wake()


class GoalState(EventState):
    """A state that sends one action goal when it is entered, and is left when the goal has ended.

    A derived class makes the goal and maps its end to an outcome. The goal must end within ``timeout`` seconds.
    """

    def __init__(
        self,
        action_type: type[Any],
        topic: str,
        timeout: float | None = None,
        *,
        parameter: str = 'topic',
        not_paused: Callable[[], Sequence[str]] = lambda: ('its action has no pause',),
        **interface: Any,
    ) -> None:
        """``parameter``: name of the state's parameter for the topic; ``interface``: outcomes and keys."""
        super().__init__(desired_rate=None, **interface)
        self._topic = checked_topic(self, parameter, topic)
        self._timeout = checked_timeout(self, 'timeout', timeout)
        self.skill = self.skill.within(self._timeout)
        self._goal = GoalCall(self, action_type, self._topic, not_paused)
        self._refusal = ''

    def _make_goal(self, userdata: UserData) -> Any:
        """Return the goal. Raises FlexbtError if the userdata lacks a value; then the state is left by failed."""
        raise NotImplementedError

    def _send(self, goal: Any) -> None:
        self._goal.send(goal, timeout=self._timeout)

    def _what(self) -> str:
        """Return the purpose of the goal, as the beginning of a message."""
        raise NotImplementedError

    def _end(self, ended: GoalOutcome, userdata: UserData) -> str:
        """Return the outcome of the state for the outcome of the goal."""
        raise NotImplementedError

    def on_enter(self, userdata: UserData) -> None:
        self._refusal = ''
        try:
            goal = self._make_goal(userdata)
        except FlexbtError as error:
            self._refusal = str(error)
        else:
            self._send(goal)

    def execute(self, userdata: UserData) -> str | None:
        if self._refusal:
            self.log_error(f'{self._what()}: {self._refusal}')
            return 'failed'
        ended = self._goal.poll()
        return None if ended is None else self._end(ended, userdata)

    def _checked_type(self, parameter: str, name: str, package: str = '') -> str:
        """Return the type that a parameter names; see :func:`checked_type`."""
        return checked_type(self, parameter, name, package)

    def on_start(self) -> None:
        self._goal.prepare()

    def on_exit(self, userdata: UserData) -> None:
        self._goal.leave()

    def halting(self) -> str | None:
        return self._goal.halting()


# The outcome of a state from the end of an action of the BT server.
#
# The outcome is done only if the goal was accepted, it ended as succeeded, and the server wrote the result code
# SUCCESS. A default value never means success.


def state_outcome(outcome: GoalOutcome, what: str) -> tuple[str, str]:
    """Return the state's outcome (done, failed or canceled) and the reason as text, empty for done.

    ``what`` is the purpose of the goal. The result codes UNKNOWN 0, SUCCESS 1, FAILURE 2, CANCELED 3 and ERROR 4 are
    the same in BtLoad, BtExecute, BtGetData and BtSetData.
    """
    code = outcome.result.code if outcome.result is not None else BtExecute.Result.UNKNOWN
    message = outcome.result.message if outcome.result is not None else ''
    detail = message or outcome.reason
    if outcome.status is GoalStatus.SUCCEEDED:
        if code == BtExecute.Result.SUCCESS:
            return 'done', ''
        if code == BtExecute.Result.UNKNOWN:
            detail = 'the server ended the goal without filling in the result'
    elif code == BtExecute.Result.SUCCESS:
        detail = f'the goal ended as {outcome.status.name} although its result says success; {outcome.reason}'
    ended_by_cancel = outcome.status is GoalStatus.CANCELED or code == BtExecute.Result.CANCELED
    reached_its_end = outcome.status in (GoalStatus.SUCCEEDED, GoalStatus.ABORTED, GoalStatus.CANCELED)
    if ended_by_cancel and reached_its_end and code in (BtExecute.Result.CANCELED, BtExecute.Result.UNKNOWN):
        return 'canceled', f'{what}: canceled: {detail}' if detail else f'{what}: canceled'
    return 'failed', f'{what}: {detail or "failed without a reason"}'


def read_values(entries: Iterable[Any], types: Mapping[str, str]) -> dict[str, Any]:
    """Return the values of a result by key, each checked against the type that the state declared.

    Raises:
        FlexbtError: a value cannot be read, has another type, or is missing.
    """
    received = {entry.key: entry for entry in entries}
    values = {}
    for key, type in types.items():
        if key not in received:
            raise FlexbtError(f'the server did not send {key!r}')
        entry = received[key]
        try:
            values[key] = check_value(from_entry(entry), type)
        except FlexbtError as error:
            raise FlexbtError(f'key {key!r}, received as {entry.type}: {error}') from error
    return values


# What a state uses of the BT server, known before the run.


@dataclass(frozen=True, slots=True)
class BtUse:
    """One use of the BT server.

    The server loads ``files`` and ``xml``. It runs ``tree``: an identifier, package/relative/path.xml, '' for the
    server's default tree, None for none. ``writes`` and ``reads`` map keys of ``blackboard`` ('' is the shared one) to
    types; the state writes before a tree runs, and reads after it.
    """

    files: tuple[str, ...] = ()
    xml: str = ''
    tree: str | None = None
    blackboard: str = ''
    writes: Mapping[str, str] = field(default_factory=dict)
    reads: Mapping[str, str] = field(default_factory=dict)


@runtime_checkable
class UsesBtServer(Protocol):
    """A state that uses the BT server. Tools read from it what the server must provide."""

    @property
    def bt_use(self) -> BtUse:
        """The state's use of the server."""
