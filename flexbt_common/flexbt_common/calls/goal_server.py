# SPDX-License-Identifier: BSD-3-Clause
"""An action server whose goals end by method calls, and the admission of its goals."""

from __future__ import annotations

import functools
from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Any, Final

from action_msgs.msg import GoalInfo, GoalStatus, GoalStatusArray
from action_msgs.srv import CancelGoal
from rclpy.action.server import RCLError
from rclpy.qos import QoSProfile, qos_profile_action_status_default

from flexbt_common.errors import LimitExceededError
from flexbt_common.runtime.node_runtime import Runtime
from flexbt_common.values.limits import check_limits, length_of
from flexbt_core.values.text import sanitize_for_message


class GoalAdmission:
    """An admission policy for all goals of ``subject``, such as 'the server'.

    ``refusal`` is the reason to reject all goals; '' to admit them. Servers with an admission policy reject goals that
    are not admitted, as the lifecycle servers of ROS do.
    """

    def __init__(self, subject: str, why: str = '') -> None:
        """Start closed if ``why`` is not ''; it follows the subject."""
        self._subject = subject
        self.refusal = ''
        if why:
            self.close(why)

    def open(self) -> None:
        """Admit goals."""
        self.refusal = ''

    def close(self, why: str) -> None:
        """Refuse goals from now on."""
        self.refusal = f'{self._subject} {why}'


# An action server whose goals end by a method call, which sends the result before it returns.
#
# This server creates the three services and two topics of the action itself. rclpy's ActionServer runs a coroutine for
# each goal. After its return, the executor needs two more turns to send the result, and sends the list of goals, which
# shows the client the end, before it. The server publishes this list with every change of any goal, and it contains all
# goals of the last ``result_timeout`` seconds, which each client unpacks. At 10 goals a second and rclpy's default of
# 15 minutes, that takes longer than the goals.
#
# This server sends the result first. Ended goals stay in the list only for a moment. Their results can be requested for
# longer; during that time the answer to a cancel is "terminated", not "unknown".

MOST_RESULTS: Final = 1000
RESULTS_LENGTH: Final = 64_000_000
"""Maximum number of kept results, and of their characters, bytes and elements; the oldest are dropped first."""

MOST_GOALS: Final = 1000
"""Default maximum number of active goals of a server: the number of requests that can wait for it."""

_COMPLAINT_SECONDS: Final = 1.0
"""Minimum time between two log lines about rejected goals, s."""

_FAULT_LIMIT: Final = 1000
"""Maximum number of characters of a fault in a result: the error may show any value."""

RESULT_SECONDS: Final = 30.0
"""Time for which the result of a goal can be requested again after an outage of the link, s."""

_LIST_AFTER_SECONDS: Final = 0.02
"""Delay from a change to publishing the list of goals, s: a client that waits for a result gets the result first."""

_LISTED_SECONDS: Final = 0.25
"""Time for which the list of goals shows a goal that has ended, s."""


@dataclass(frozen=True)
class GoalFault:
    """A fault that is injected into a server, to test its clients. It affects active goals too, except ``refusal``,
    which affects only new ones.

    ``refusal``: reason to reject goals, or ''. ``failure``: result with which goals are aborted. ``hangs``: the server
    accepts goals without starting them, withdraws active ones, and does not answer cancels. Goals and cancels wait for
    the end of the fault. Withdrawn goals start again then.
    """

    refusal: str = ''
    failure: Any = None
    hangs: bool = False


@dataclass(eq=False)
class _Goal:
    """The state of a goal for its clients. ``askers`` are the pending requests for its result."""

    info: GoalInfo
    request: Any
    status: int = GoalStatus.STATUS_EXECUTING
    askers: list[Any] = field(default_factory=list)

    @property
    def id(self) -> bytes:
        return bytes(self.info.goal_id.uuid)

    @property
    def has_ended(self) -> bool:
        return self.status not in (GoalStatus.STATUS_EXECUTING, GoalStatus.STATUS_CANCELING)


class ServedGoal:
    """An accepted goal. Executor thread only, except that any thread may read ``cancel_requested``.

    ``id``: 16 bytes. ``request``: the goal message.
    """

    def __init__(self, server: GoalServer, goal: _Goal) -> None:
        self.id = goal.id
        self.request: Any = goal.request
        self._server = server
        self._goal = goal
        self._active = True
        self._withdrawn = False
        self._on_cancel: list[Callable[[], None]] = []

    @property
    def active(self) -> bool:
        """True until the goal is ended."""
        return self._active

    @property
    def cancel_requested(self) -> bool:
        """True if the goal is active and its client has requested a cancel, or if the goal is withdrawn."""
        return self._withdrawn or (self._active and self._goal.status == GoalStatus.STATUS_CANCELING)

    def on_cancel(self, fn: Callable[[], None]) -> None:
        """Call ``fn`` when ``cancel_requested`` becomes true before the end of the goal."""
        self._on_cancel.append(fn)

    def notify_cancel(self) -> None:
        """Call the functions registered by :meth:`on_cancel`; for the server."""
        waiting, self._on_cancel = self._on_cancel, []
        for fn in waiting:
            fn()

    def publish_feedback(self, feedback: Any) -> None:
        """Publish feedback. No effect after the end."""
        if self._active:
            self._server.publish_feedback(self._goal, feedback)

    def succeed(self, result: Any) -> None:
        """End the goal as succeeded. Ending a goal a second time has no effect."""
        self._end(GoalStatus.STATUS_SUCCEEDED, result)

    def abort(self, result: Any) -> None:
        """End the goal as aborted."""
        self._end(GoalStatus.STATUS_ABORTED, result)

    def canceled(self, result: Any) -> None:
        """End the goal as canceled, or as aborted if its client has not requested a cancel, since ROS requires that."""
        self._end(GoalStatus.STATUS_CANCELED if self.cancel_requested else GoalStatus.STATUS_ABORTED, result)

    def withdraw(self) -> None:
        """Withdraw the goal from its worker, which sees a cancel. Feedback and results of this worker are dropped."""
        self._active, self._withdrawn = False, True

    def as_accepted(self) -> ServedGoal:
        """Return the goal in the state after its acceptance, for the next worker."""
        return ServedGoal(self._server, self._goal)

    def _end(self, status: int, result: Any) -> None:
        if self._active:
            self._active = False
            self._server.end(self._goal, status, result)


class GoalServer:
    """A server of one action. Executor thread only; closed with the runtime at the latest.

    ``on_goal(goal)`` is called with each goal, which is accepted and has the status executing. It, or the work it
    starts, must end the goal. If it raises, the server reports the fault and aborts the goal. When the client cancels
    the goal, ``cancel_requested`` becomes true, and the server calls the functions of :meth:`ServedGoal.on_cancel` and
    ``on_cancel(goal)``. The goal may end at once, later, or with another status. A server that is not ``cancelable``
    rejects cancels.

    Goals that exceed :mod:`flexbt_common.values.limits`, or the number ``most`` of active goals, are aborted with the
    result ``refused(why)`` without a call of ``on_goal``. Goals not admitted by ``admission`` are rejected. ROS cannot
    return a reason to the client then, so the node logs it. ``admission`` may be replaced.
    The server ends with its node or :class:`NodeScope`, if not before.
    """

    def __init__(
        self,
        runtime: Runtime,
        action_type: Any,
        name: str,
        on_goal: Callable[[ServedGoal], None],
        on_cancel: Callable[[ServedGoal], None] | None = None,
        refused: Callable[[str], Any] | None = None,
        most: int = MOST_GOALS,
        admission: GoalAdmission | None = None,
        cancelable: bool = True,
    ) -> None:
        """``refused``: by default for results like Nav2's, with ``error_code`` and ``error_msg``."""
        self._runtime = runtime
        self._name = name
        self._action_type = action_type
        self._refused = refused or functools.partial(_refusal, action_type)
        self._most = most
        self.admission = admission or GoalAdmission(name)
        self._on_goal = on_goal
        self._on_cancel = on_cancel
        self._cancelable = cancelable
        self._goals: dict[bytes, ServedGoal] = {}
        self.listed: dict[bytes, _Goal] = {}
        """Goals in the published list, by ID."""
        self._is_listed_soon = False
        self._held_cancels: deque[tuple[Any, Any]] = deque(maxlen=MOST_GOALS)
        self.results = _Results()
        """Results of ended goals."""
        self._fault = GoalFault()
        self._is_closed = False
        impl, node = action_type.Impl, runtime.node
        self._goal_service = self._service('send_goal', impl.SendGoalService, self._answer_goal)
        self._cancel_service = self._service('cancel_goal', impl.CancelGoalService, self._answer_cancel)
        self._result_service = self._service('get_result', impl.GetResultService, self._answer_result)
        self._feedback = node.create_publisher(impl.FeedbackMessage, f'{name}/_action/feedback', QoSProfile(depth=10))
        self._list = node.create_publisher(GoalStatusArray, f'{name}/_action/status', qos_profile_action_status_default)
        runtime.once(goal_servers, _no_servers)[name] = self
        runtime.on_close(self._close_at_end)

    def close(self) -> None:
        """Remove the server from the graph. Active goals get no result."""
        self._runtime.cancel_on_close(self._close_at_end)
        self._runtime.once(goal_servers, _no_servers).pop(self._name, None)
        self._publish_list()
        self._is_closed = True
        node = self._runtime.node
        for service in (self._goal_service, self._cancel_service, self._result_service):
            node.destroy_service(service)
        for publisher in (self._feedback, self._list):
            node.destroy_publisher(publisher)

    @property
    def fault(self) -> GoalFault:
        """Fault that is injected into the server."""
        return self._fault

    @fault.setter
    def fault(self, fault: GoalFault) -> None:
        if fault == self._fault:
            return
        self._fault = fault
        for goal in list(self._goals.values()):
            if goal.active and (fault.hangs or fault.failure is not None):
                self._withdraw(goal)
        while self._held_cancels and not fault.hangs:
            request, header = self._held_cancels.popleft()
            answer = self._answer_cancel(request, self._action_type.Impl.CancelGoalService.Response())
            self._cancel_service.send_response(answer, header)
        for goal in [goal for goal in self._goals.values() if not goal.active]:
            self._begin(goal.as_accepted())

    @property
    def busy(self) -> bool:
        """True if a goal is active."""
        return bool(self._goals)

    def end_all(self, end: Callable[[ServedGoal, Any], None]) -> None:
        """End all goals, including those that wait, for example for the end of a fault. Their workers are notified as
        by a cancel; then ``end(goal, result)`` is called with an empty result.
        """
        for goal in list(self._goals.values()):
            if goal.active:
                self._withdraw(goal)
            end(goal.as_accepted(), self._action_type.Result())

    def _close_at_end(self) -> None:
        self._runtime.call(self.close)

    def _service(self, part: str, service_type: Any, answer: Callable[[Any, Any], Any]) -> Any:
        """Create a service of the action. ``answer`` may return a function instead of a response: it gets the header of
        the request, for a later answer."""
        service: Any = self._runtime.node.create_service(service_type, f'{self._name}/_action/{part}', answer)
        send = service.send_response

        def send_or_wait(response: Any, header: Any) -> None:
            if callable(response):
                response(header)
                return
            try:
                send(response, header)
            except RCLError:
                self._runtime.node.get_logger().warning(f'an answer of {self._name} was not sent: its client is gone')

        service.send_response = send_or_wait
        return service

    def _answer_goal(self, request: Any, response: Any) -> Any:
        refusal = self.admission.refusal or self._fault.refusal
        if refusal:
            self._runtime.node.get_logger().warning(
                f'a goal of {self._name} was rejected: {refusal}', throttle_duration_sec=_COMPLAINT_SECONDS
            )
        if refusal or bytes(request.goal_id.uuid) in self.listed:
            return response
        response.accepted = True
        response.stamp = self._runtime.node.get_clock().now().to_msg()
        goal = _Goal(GoalInfo(goal_id=request.goal_id, stamp=response.stamp), request.goal)

        def accept(header: Any) -> None:
            self.listed[goal.id] = goal
            self.results.drop(goal.id)  # the result of an older goal with the same ID
            self._goal_service.send_response(response, header)
            self._list_soon()
            self._begin(ServedGoal(self, goal))

        return accept

    def _answer_cancel(self, request: Any, response: Any) -> Any:
        """Answer a cancel request by the rules of action_msgs/srv/CancelGoal."""
        if self._fault.hangs:
            return lambda header: self._held_cancels.append((request, header))
        goal_id, until = bytes(request.goal_info.goal_id.uuid), _moment(request.goal_info)
        known = self.listed.get(goal_id)
        if not any(until) and any(goal_id):
            asked = [known] if known is not None else []
            if (known is not None and known.has_ended) or (known is None and goal_id in self.results):
                response.return_code = CancelGoal.Response.ERROR_GOAL_TERMINATED
            elif known is None:
                response.return_code = CancelGoal.Response.ERROR_UNKNOWN_GOAL_ID
        else:
            asked = [
                goal for goal in self.listed.values() if goal is known or not any(until) or _moment(goal.info) <= until
            ]
        active = [goal for goal in asked if not goal.has_ended]
        if active and not self._cancelable:
            response.return_code = CancelGoal.Response.ERROR_REJECTED
            return response
        for goal in active:
            response.goals_canceling.append(goal.info)
            self._cancel(goal)
        return response

    def _cancel(self, goal: _Goal) -> None:
        served = self._goals[goal.id]
        if goal.status == GoalStatus.STATUS_EXECUTING:
            goal.status = GoalStatus.STATUS_CANCELING
            self._list_soon()
            self._runtime.post(lambda: self._notify_cancel(served) if served.active else None)

    def _answer_result(self, request: Any, response: Any) -> Any:
        goal_id = bytes(request.goal_id.uuid)
        goal = self.listed.get(goal_id)
        if goal is not None and not goal.has_ended:
            return goal.askers.append
        return self.results.get(goal_id) or response

    def publish_feedback(self, goal: _Goal, feedback: Any) -> None:
        """Publish feedback of a goal; for :class:`ServedGoal`."""
        if not self._is_closed:
            message = self._action_type.Impl.FeedbackMessage(goal_id=goal.info.goal_id, feedback=feedback)
            self._feedback.publish(message)

    def end(self, goal: _Goal, status: int, result: Any) -> None:
        """End a goal, once; for :class:`ServedGoal`."""
        self._goals.pop(goal.id, None)
        if self._is_closed:
            return
        goal.status = status
        response = self._action_type.Impl.GetResultService.Response(status=status, result=result)
        for header in goal.askers:
            self._result_service.send_response(response, header)
        goal.askers.clear()
        self.results.keep(goal.id, response)
        self._list_soon()
        self._runtime.post_in(_LISTED_SECONDS, lambda: self.listed.pop(goal.id))
        self._runtime.post_in(RESULT_SECONDS, functools.partial(self.results.drop, goal.id, response))

    def _list_soon(self) -> None:
        if not self._is_listed_soon:
            self._is_listed_soon = True
            self._runtime.post_in(_LIST_AFTER_SECONDS, self._publish_list)

    def _publish_list(self) -> None:
        if self._is_listed_soon and not self._is_closed:
            self._is_listed_soon = False
            goals = [GoalStatus(goal_info=goal.info, status=goal.status) for goal in self.listed.values()]
            self._list.publish(GoalStatusArray(status_list=goals))

    def _begin(self, goal: ServedGoal) -> None:
        self._goals[goal.id] = goal
        try:
            check_limits(goal.request)
            if len(self._goals) > self._most:
                raise LimitExceededError(f'{self._name} serves {self._most} goals at a time; try again later')
            if self._fault.hangs:
                goal.withdraw()
            elif self._fault.failure is not None:
                goal.abort(self._fault.failure)
            else:
                self._on_goal(goal)
                if goal.cancel_requested:  # the client has canceled the withdrawn goal
                    self._notify_cancel(goal)
        except LimitExceededError as error:
            goal.abort(self._refused(str(error)))
        except Exception as error:
            self._runtime.report_fault(error, f'goal of {self._name}')
            goal.abort(self._refused(sanitize_for_message(f'fault in the server: {error!r}', _FAULT_LIMIT)))

    def _withdraw(self, goal: ServedGoal) -> None:
        goal.withdraw()
        self._notify_cancel(goal)

    def _notify_cancel(self, goal: ServedGoal) -> None:
        goal.notify_cancel()
        if self._on_cancel is not None:
            self._on_cancel(goal)


def _moment(info: GoalInfo) -> tuple[int, int]:
    return info.stamp.sec, info.stamp.nanosec


def goal_servers(runtime: Runtime) -> Mapping[str, GoalServer]:
    """Return the goal servers of a node, by the names of their actions. For the executor thread."""
    return MappingProxyType(runtime.once(goal_servers, _no_servers))


def _no_servers(_runtime: Runtime) -> dict[str, GoalServer]:
    return {}


def set_error(result: Any, code: int, message: str) -> None:
    """Fill in the error fields of results like Nav2's. (Results of routes have no message.)"""
    result.error_code = code
    if hasattr(result, 'error_msg'):
        result.error_msg = message


def _refusal(action_type: Any, why: str) -> Any:
    result = action_type.Result()
    set_error(result, int(getattr(result, 'UNKNOWN', 0)), why)
    return result


class _Results:
    """The results of ended goals by ID, up to MOST_RESULTS and RESULTS_LENGTH."""

    def __init__(self) -> None:
        self._responses: dict[bytes, Any] = {}
        self._lengths: dict[bytes, int] = {}

    def __contains__(self, goal_id: bytes) -> bool:
        return goal_id in self._responses

    def get(self, goal_id: bytes) -> Any | None:
        """Return the kept response for a goal, or None."""
        return self._responses.get(goal_id)

    def keep(self, goal_id: bytes, response: Any) -> None:
        """Keep a result, and drop the oldest ones beyond the limits."""
        self._responses[goal_id] = response
        self._lengths[goal_id] = length_of(response.result)
        while len(self._responses) > MOST_RESULTS or (
            sum(self._lengths.values()) > RESULTS_LENGTH and len(self._responses) > 1
        ):
            self.drop(next(iter(self._responses)))

    def drop(self, goal_id: bytes, response: Any = None) -> None:
        """Drop the result of a goal, if any; with ``response`` only that one, and not one of a later goal."""
        if response is not None and self._responses.get(goal_id) is not response:
            return
        self._responses.pop(goal_id, None)
        self._lengths.pop(goal_id, None)
