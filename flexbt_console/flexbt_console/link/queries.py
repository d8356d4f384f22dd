# SPDX-License-Identifier: BSD-3-Clause
"""Actions that the console asks the executive for: the userdata of the run, and the synthesis of a behavior."""

from __future__ import annotations

import contextlib
import threading
from collections.abc import Callable, Sequence
from concurrent.futures import Future, InvalidStateError
from dataclasses import asdict
from typing import Any, Final

from std_srvs.srv import Trigger

from flexbt_common import names
from flexbt_common.calls.action_call import ActionCall, ActionLinks, GoalOutcome
from flexbt_common.calls.service_call import ServiceLinks, service_outcome
from flexbt_common.runtime.node_runtime import NodeRuntime
from flexbt_console.errors import ConsoleError, NoAnswerError, RefusedError
from flexbt_console.mirror.records import LIVENESS, Synthesis, SynthesisRequest, TreeBlackboard, UserdataScope
from flexbt_msgs.action import GetUserdata, SynthesizeBehavior
from flexbt_msgs.srv import GetTreeBlackboard

from .messages import record_of


def userdata(
    runtime: NodeRuntime, namespace: str, path: str, keys: Sequence[str], timeout: float
) -> tuple[UserdataScope, ...]:
    """Ask the executive of the robot in a namespace, '' for the node's own. Not on the executor thread.

    As a path, '' is that of every active machine; no keys are all.

    Raises:
        RefusedError: nothing runs, the machine is not active, or the key does not exist.
        NoAnswerError: there is no answer within ``timeout`` seconds, since a state keeps the run busy, or the link
            is bad.
    """
    done: Future[GoalOutcome] = Future()
    goal = GetUserdata.Goal(path=path, keys=list(keys), encoding=GetUserdata.Goal.TEXT)
    link = ActionLinks(runtime).link(GetUserdata, names.of_robot(namespace, names.GET_USERDATA))
    call = ActionCall(link, goal, on_done=done.set_result, server_timeout=timeout, accept_timeout=timeout)
    try:
        outcome = done.result(timeout)
    except TimeoutError:
        call.cancel()
        raise NoAnswerError(f'no userdata arrived within {timeout:g} s; a state may keep the run busy') from None
    result = outcome.result
    if result is None:
        raise NoAnswerError(outcome.reason)
    if result.code != GetUserdata.Result.SUCCESS:
        raise RefusedError(result.message)
    return tuple(map(record_of, result.scopes))


def blackboard(
    runtime: NodeRuntime, namespace: str, run_id: str, keys: Sequence[str], timeout: float
) -> TreeBlackboard:
    """Ask the BT server of the robot in a namespace, '' for the node's own. Not on the executor thread.

    Raises:
        RefusedError: no tree runs, several do and ``run_id`` is '', or a key does not exist.
        NoAnswerError: there is no answer within ``timeout`` seconds.
    """
    link = ServiceLinks(runtime).link(GetTreeBlackboard, names.of_robot(namespace, names.GET_TREE_BLACKBOARD))
    outcome = service_outcome(link, GetTreeBlackboard.Request(run_id=run_id, keys=list(keys)), timeout)
    response = outcome.response
    if response is None:
        raise NoAnswerError(outcome.reason)
    if not response.success:
        raise RefusedError(response.message)
    board: TreeBlackboard = record_of(response)
    return board


def write_incident(runtime: NodeRuntime, namespace: str, timeout: float) -> str:
    """Have the black box of the robot in a namespace write an incident; return its folder there. Not on the executor
    thread.

    Raises:
        RefusedError: it does not write one.
        NoAnswerError: there is no answer within ``timeout`` seconds.
    """
    link = ServiceLinks(runtime).link(Trigger, names.of_robot(namespace, names.WRITE_INCIDENT))
    outcome = service_outcome(link, Trigger.Request(), timeout)
    if outcome.response is None:
        raise NoAnswerError(f'{outcome.reason}; the executable black_box writes incidents')
    if not outcome.response.success:
        raise RefusedError(outcome.response.message or 'the black box writes no incident now')
    return str(outcome.response.message)


# Having a behavior synthesized: goals of the action ``synthesize_behavior``.

Goal, Result = SynthesizeBehavior.Goal, SynthesizeBehavior.Result

_GRACE: Final = 15.0
"""Time beyond the time limit for which the answer is awaited, s: the search has to be started, and ended."""
_CANCEL_SECONDS: Final = 0.5
"""Time for which the end of the console waits until its cancels are sent, s."""

_LIVENESS: Final = dict(zip(LIVENESS, (Goal.FAIR, Goal.ADVERSARIAL, Goal.FAIR_OUTCOMES), strict=True))

_CONSOLE_ENDS: Final = 'the console ends'

Tell = Callable[[str], None]


class SynthesisQuery:
    """A client that asks the executive of a robot in the name of an operator; '' is the node's own namespace."""

    def __init__(self, runtime: NodeRuntime, namespace: str, operator: str) -> None:
        self._runtime = runtime
        self._name = names.of_robot(namespace, names.SYNTHESIZE_BEHAVIOR)
        self._operator = operator
        self._lock = threading.Lock()
        self._calls: dict[ActionCall, Future[GoalOutcome]] = {}
        self._has_ended = False
        runtime.on_close(self._close)

    def ask(self, request: SynthesisRequest, timeout: float, tell: Tell, left: Future[None] | None = None) -> Synthesis:
        """Wait for the answer; ``tell`` receives progress from time to time. Not on the executor thread.

        The search is canceled when the wait is interrupted, when ``left`` is done, and when the node ends.
        ``timeout`` in seconds is for the acceptance.

        Raises:
            RefusedError: something is wrong with the request or its files, or it was canceled.
            NoAnswerError: there was no answer in the time that the search has, or nobody waits for it any more.
            ConsoleError: the search failed.
        """
        done: Future[GoalOutcome] = Future()
        link = ActionLinks(self._runtime).link(SynthesizeBehavior, self._name)
        call = ActionCall(
            link,
            self._goal(request),
            on_done=lambda outcome: _end(done, outcome),
            on_feedback=_seldom(tell),
            server_timeout=timeout,
            accept_timeout=timeout,
            outage_timeout=timeout,
        )
        with self._lock:
            self._calls[call] = done
            if self._has_ended:
                _end(done, NoAnswerError(_CONSOLE_ENDS))
        if left is not None:
            left.add_done_callback(lambda _: _end(done, NoAnswerError('the page that requested it was closed')))
        try:
            outcome = done.result(request.time_limit + 2.0 * timeout + _GRACE)
        except TimeoutError:
            raise NoAnswerError('there was no answer within the time limit of the search') from None
        finally:
            call.cancel()
            with self._lock:
                del self._calls[call]
        return _answer(outcome)

    def cancel(self, timeout: float) -> int:
        """Cancel the searches requested here, or else those of anybody; return their number.

        Not on the executor thread. Raises NoAnswerError when the executive did not answer within ``timeout`` seconds.
        """
        with self._lock:
            calls = [call for call in self._calls if not call.done]
        for call in calls:
            call.cancel()
        return len(calls) or self._cancel_all(timeout)

    def _cancel_all(self, timeout: float) -> int:
        """Cancel all goals of the action, by a request without ID and time: the requester may be gone.
        Return their number."""
        service: Any = SynthesizeBehavior.Impl.CancelGoalService
        link = ServiceLinks(self._runtime).link(service, f'{self._name}/_action/cancel_goal')
        outcome = service_outcome(link, service.Request(), timeout)
        if outcome.response is None:
            raise NoAnswerError(outcome.reason)
        return len(outcome.response.goals_canceling)

    def _close(self) -> None:
        with self._lock:
            self._has_ended = True
            calls = dict(self._calls)
        for call, done in calls.items():
            call.cancel()
            _end(done, NoAnswerError(_CONSOLE_ENDS))
        if calls:
            with contextlib.suppress(RuntimeError, TimeoutError):  # the executor has ended, or is busy
                self._runtime.call(lambda: None, _CANCEL_SECONDS)  # after the cancels

    def _goal(self, request: SynthesisRequest) -> Any:
        fields = {**asdict(request), 'liveness': _LIVENESS[request.liveness]}
        return Goal(**fields, operator_id=self._operator)


def _end(done: Future[GoalOutcome], how: GoalOutcome | NoAnswerError) -> None:
    """End a call. Only the first end counts."""
    with contextlib.suppress(InvalidStateError):
        if isinstance(how, GoalOutcome):
            done.set_result(how)
        else:
            done.set_exception(how)


def _seldom(tell: Tell) -> Callable[[Any], None]:
    """Feedback as lines: after 2 s, then each time that the elapsed time has doubled."""
    due = 2.0

    def on_feedback(feedback: Any) -> None:
        nonlocal due
        if feedback.seconds >= due:
            due = 2.0 * feedback.seconds
            tell(f'{feedback.seconds:.0f} s: {feedback.doing}')

    return on_feedback


def _answer(outcome: GoalOutcome) -> Synthesis:
    result = outcome.result
    if result is None:
        raise NoAnswerError(outcome.reason)
    if result.code == Result.ERROR:
        raise ConsoleError(result.message)
    if result.code not in (Result.SUCCESS, Result.UNREALIZABLE):
        raise RefusedError(result.message or outcome.reason)
    made: Synthesis = record_of(result)
    return made
