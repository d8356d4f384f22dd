# SPDX-License-Identifier: BSD-3-Clause
"""The action goal of a state, sent on entry and ended on exit, its outcome, and the use of the BT server."""

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
"""Time to wait for a server when all nodes that are alive are ready, s of wall time."""

_ENDED: Final = frozenset(
    (GoalStatus.SUCCEEDED, GoalStatus.ABORTED, GoalStatus.CANCELED, GoalStatus.REJECTED, GoalStatus.NO_SERVER)
)
"""Ends of a goal after which certainly no server works on it."""


class GoalCall:
    """One goal at a time on one action server, on behalf of a state.

    The state is woken when the goal is done or its time is up. A goal that is still active when the state is left is
    canceled, and the state has not halted before that is confirmed, or the server is gone. ``not_paused`` says why the
    goal goes on while the state is paused, or what of it does; nothing if it does not. ``services`` are those of the
    run, from :meth:`prepare` on: feedback may come when the run has ended, and the state is part of none.
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
        """True if certainly no server works on the last goal."""
        outcome = None if self._last is None else self._last.outcome
        return outcome is not None and outcome.status in _ENDED

    @property
    def last_result(self) -> Any:
        """Result of the last goal; None if the server returned none, or has not yet."""
        outcome = None if self._last is None else self._last.outcome
        return None if outcome is None else outcome.result

    def prepare(self) -> None:
        """Look for the server already: called when the run starts, so that discovery is over when the goal is sent."""
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
        """Send a goal. Its result has to come within ``timeout`` seconds on ``clock`` (default: wall time)."""
        self.prepare()
        assert self._link is not None
        self._outcome = None
        self._timeout = timeout
        if timeout is not None:
            self._clock = clock or self.services.runtime.steady
            self._deadline = self._clock.now() + timeout
            self._timer = self._clock.call_at(self._deadline, self._state.wake)
        # A server of a node that is about to be ready will be there.
        patience = READY_SECONDS if self.services.unready() else SERVER_SECONDS
        self._call = self._last = ActionCall(
            self._link, goal, on_done=self._on_done, on_feedback=on_feedback, server_timeout=patience
        )
        self.services.goals.add(self._state, self._topic, self._call, self._not_paused)

    def poll(self) -> GoalOutcome | None:
        """Return the outcome, or None while the goal is worked on. When its time is up the goal is canceled."""
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
        """Return what has not halted yet: a goal whose end is not confirmed. None if there is none."""
        for call in [call for call in self._unfinished if call.done]:
            self._unfinished.remove(call)
            if call.outcome is not None and call.outcome.status not in _ENDED:
                self._state.log_warn(f'it is not known whether the goal has ended: {call.outcome.reason}')
        return f'goal of {self._topic} not confirmed canceled' if self._unfinished else None

    def _on_done(self, outcome: GoalOutcome) -> None:
        self._state.wake()


class GoalState(EventState):
    """A state that sends one action goal when it is entered, and is left when that has ended.

    A derived state makes the goal, and says what its end means. The goal has to end within ``timeout`` seconds.
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
        """Return the goal. Raises FlexbtError if the userdata has no value for it: the state is left as failed."""
        raise NotImplementedError

    def _send(self, goal: Any) -> None:
        self._goal.send(goal, timeout=self._timeout)

    def _what(self) -> str:
        """Return what the goal is for, as the begin of a message."""
        raise NotImplementedError

    def _end(self, ended: GoalOutcome, userdata: UserData) -> str:
        """Return the outcome of the state by that of the goal."""
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


# From the end of a BT server's action to the outcome of a state.
#
# Three things have to agree before anything counts as done: the goal was accepted, it ended as succeeded, and the
# server wrote the result code SUCCESS. A default value never means success.


def state_outcome(outcome: GoalOutcome, what: str) -> tuple[str, str]:
    """Return the state's outcome (done, failed or canceled) and the reason for a person; the reason is empty when done.

    ``what`` was to be done. The result codes UNKNOWN 0, SUCCESS 1, FAILURE 2, CANCELED 3 and ERROR 4 are the same in
    BtLoad, BtExecute, BtGetData and BtSetData.
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


# What a state wants of the BT server, as it is known before anything runs.


@dataclass(frozen=True, slots=True)
class BtUse:
    """One use of the BT server.

    ``files`` and ``xml`` are loaded. ``tree`` is run: an identifier, package/relative/path.xml, '' for the server's
    default tree, None when none is run. ``writes`` and ``reads`` are keys of ``blackboard`` ('' is the shared one) with
    their types, from the point of view of the state: it writes before a tree runs, and reads after it.
    """

    files: tuple[str, ...] = ()
    xml: str = ''
    tree: str | None = None
    blackboard: str = ''
    writes: Mapping[str, str] = field(default_factory=dict)
    reads: Mapping[str, str] = field(default_factory=dict)


@runtime_checkable
class UsesBtServer(Protocol):
    """A state that uses the BT server; tools find out by this what it needs there."""

    @property
    def bt_use(self) -> BtUse:
        """Use that the state makes of the server."""
