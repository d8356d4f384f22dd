# SPDX-License-Identifier: BSD-3-Clause
"""An action server whose goals are ended by calls, and the admission of its goals."""

from __future__ import annotations

import functools
from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any, Final, Protocol

from action_msgs.srv import CancelGoal
from builtin_interfaces.msg import Time
from rclpy.action import ActionServer, CancelResponse, GoalResponse
from rclpy.action.server import GoalEvent, ServerGoalHandle
from rclpy.task import Future

from flexbt_common.errors import LimitExceededError
from flexbt_common.middleware.rclpy_private import ACTION_SERVER, ExtendedActionServer, is_usable
from flexbt_common.names import action_service_qos
from flexbt_common.runtime.node_runtime import Runtime
from flexbt_common.values.limits import check_limits, length_of
from flexbt_core.values.text import sanitize_for_message


class GoalAdmission:
    """One for all goals of ``subject``, such as 'the server'. ``refusal``: why none is admitted; '' when all are.

    A server that is given one rejects the goals that are not admitted, as the lifecycle servers of ROS do.
    """

    def __init__(self, subject: str, why: str = '') -> None:
        """Closed if ``why``, which follows the subject, is given."""
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


# An action server whose goals are ended by a call, and whose results are on their way when that call returns.
#
# rclpy's own runs a coroutine for each goal. When that has returned, the result takes two more turns of the executor
# until it is sent, after the list of goals that tells the client of the end. And the list, which goes out with every
# change of any goal, has all goals of the last ``result_timeout`` seconds in it, which each client unpacks: at 10 goals
# a second and the 15 minutes of rclpy's default that is longer than the goals take.
#
# Here the result leaves first. Ended goals stay in the list for a moment only; their results can be asked for longer,
# and as long a cancel is answered with "terminated", not with "unknown". That takes private parts of rclpy: where it
# lacks them, its own server does all this in its own way.

MOST_RESULTS: Final = 1000
RESULTS_LENGTH: Final = 64_000_000
"""How many results are kept, and how many characters, bytes and elements they have together; the oldest go first."""

MOST_GOALS: Final = 1000
"""Goals that a server works on at a time, unless it says otherwise: as many as requests that can wait for it."""

_COMPLAINT_SECONDS: Final = 1.0
"""Between two lines of the log about goals that are rejected, s."""

_FAULT_LIMIT: Final = 1000
"""Characters of what a client is told of a fault: the error may show any value."""

RESULT_SECONDS: Final = 30.0
"""How long the result of a goal can be asked for again, after an outage of the link."""

_LIST_AFTER_SECONDS: Final = 0.02
"""How much later than a change the list of goals is sent: who waits for a result need not unpack a list meanwhile."""

_LISTED_SECONDS: Final = 0.25
"""How long the list of goals tells of a goal that has ended."""


@dataclass(frozen=True)
class GoalFault:
    """What is wrong with a server on command, so that it is seen how its clients bear it. All goals are concerned,
    those that it works on too, except by a refusal.

    ``refusal``: why goals are rejected; '' when they are not. ``failure``: the result with which goals are aborted.
    ``hangs``: goals are accepted and not begun, those that had been are withdrawn, and cancels are not answered. Goals
    and cancels wait for the end of the fault; a goal that was withdrawn is begun anew then.
    """

    refusal: str = ''
    failure: Any = None
    hangs: bool = False


class _Ends(Protocol):
    """What ends goals."""

    def end(self, handle: ServerGoalHandle, event: GoalEvent, result: Any) -> None:
        """Make the transition, once, and send the result."""


class ServedGoal:
    """A goal that was accepted. Used on the executor thread; ``cancel_requested`` may be read on any.

    ``id``: 16 bytes. ``request``: the goal message.
    """

    def __init__(self, server: _Ends, handle: ServerGoalHandle) -> None:
        self.id = bytes(handle.goal_id.uuid)
        self.request: Any = handle.request
        self._server = server
        self._handle = handle
        self._active = True
        self._withdrawn = False
        self._on_cancel: list[Callable[[], None]] = []

    @property
    def active(self) -> bool:
        """Whether the goal has not been ended."""
        return self._active

    @property
    def cancel_requested(self) -> bool:
        """Whether the client has asked for the goal to be canceled, and it has not ended yet; or it is withdrawn."""
        return self._withdrawn or (self._active and bool(self._handle.is_cancel_requested))

    def on_cancel(self, fn: Callable[[], None]) -> None:
        """Have ``fn`` called when ``cancel_requested`` begins to hold, as long as the goal has not ended."""
        self._on_cancel.append(fn)

    def notify_cancel(self) -> None:
        """Call those who asked for it; for the server."""
        waiting, self._on_cancel = self._on_cancel, []
        for fn in waiting:
            fn()

    def publish_feedback(self, feedback: Any) -> None:
        """Send feedback; nothing after the end."""
        if self._active:
            self._handle.publish_feedback(feedback)

    def succeed(self, result: Any) -> None:
        """End the goal: what it asked for was done. Whoever ends a goal a second time changes nothing."""
        self._end(GoalEvent.SUCCEED, result)

    def abort(self, result: Any) -> None:
        """End the goal: it was not done."""
        self._end(GoalEvent.ABORT, result)

    def canceled(self, result: Any) -> None:
        """End the goal as canceled; when its client did not ask for that, it is aborted: ROS knows no other way."""
        self._end(GoalEvent.CANCELED if self.cancel_requested else GoalEvent.ABORT, result)

    def withdraw(self) -> None:
        """Take the goal from who works on it, for whom it is as if canceled: what he says of it is not told."""
        self._active, self._withdrawn = False, True

    def as_accepted(self) -> ServedGoal:
        """Return the goal as it was when it was accepted, for who works on it next."""
        return ServedGoal(self._server, self._handle)

    def _end(self, event: GoalEvent, result: Any) -> None:
        if self._active:
            self._active = False
            self._server.end(self._handle, event, result)


class GoalServer:
    """Serves one action. Made and used on the executor thread; closed with the runtime, unless it was before.

    ``on_goal(goal)`` is called with each goal, which is accepted and shown as executing; it, or what it sets going, has
    to end the goal. When it raises, the fault is reported and the goal aborted. That the client wants the goal canceled
    shows in ``cancel_requested``, and is told to :meth:`ServedGoal.on_cancel` and to ``on_cancel(goal)``; the goal may
    end at once, later, or otherwise. Of a server that is not ``cancelable`` cancels are rejected.

    Goals with more in them than :mod:`flexbt_common.values.limits` allows, and more than ``most`` at a time, never get
    there: they are aborted with ``refused(why)``, the result for a reason. Those that ``admission`` does not admit are
    rejected; ROS has no way to tell the client why, so the log of the node does. It may be replaced.

    It ends with the node, or the :class:`NodeScope`, that it is made on, if not before.
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
        """``refused`` is by default for results as those of Nav2, with ``error_code`` and ``error_msg``."""
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
        server_class = _Server if is_usable(ACTION_SERVER) else _StockServer
        self._server = server_class(
            runtime,
            action_type,
            name,
            goal_callback=self._admit,
            handle_accepted_callback=self._accepted,
            cancel_callback=self._cancel,
            **action_service_qos(),
        )
        self._server.on_end = self._goals.pop
        self._fault = GoalFault()
        runtime.once(goal_servers, _no_servers)[name] = self
        runtime.on_close(self._close_at_end)

    def close(self) -> None:
        """Take the server out of the graph. Goals that have not ended get no result."""
        self._runtime.cancel_on_close(self._close_at_end)
        self._runtime.once(goal_servers, _no_servers).pop(self._name, None)
        self._server.destroy()

    @property
    def fault(self) -> GoalFault:
        """What is wrong with the server on command."""
        return self._fault

    @fault.setter
    def fault(self, fault: GoalFault) -> None:
        if fault == self._fault:
            return
        self._fault = fault
        for goal in list(self._goals.values()):
            if goal.active and (fault.hangs or fault.failure is not None):
                self._withdraw(goal)
        self._server.hold_cancels(fault.hangs, self._begin_again)

    @property
    def busy(self) -> bool:
        """Whether a goal has not ended."""
        return bool(self._goals)

    def end_all(self, end: Callable[[ServedGoal, Any], None]) -> None:
        """End all goals, also those that wait for something, as for the end of a fault: nobody is left who would stop
        them. Who works on them is told as by a cancel; then ``end(goal, result)`` is called, with an empty result.
        """
        for goal in list(self._goals.values()):
            if goal.active:
                self._withdraw(goal)
            end(goal.as_accepted(), self._action_type.Result())

    def _close_at_end(self) -> None:
        self._runtime.call(self.close)

    def _admit(self, _request: Any) -> GoalResponse:
        refusal = self.admission.refusal or self._fault.refusal
        if not refusal:
            return GoalResponse.ACCEPT
        self._runtime.node.get_logger().warning(
            f'a goal of {self._name} was rejected: {refusal}', throttle_duration_sec=_COMPLAINT_SECONDS
        )
        return GoalResponse.REJECT

    def _accepted(self, handle: ServerGoalHandle) -> None:
        self._server.begin(handle)
        self._begin(ServedGoal(self._server, handle))

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
                if goal.cancel_requested:  # while it was withdrawn
                    self._notify_cancel(goal)
        except LimitExceededError as error:
            goal.abort(self._refused(str(error)))
        except Exception as error:
            self._runtime.report_fault(error, f'goal of {self._name}')
            goal.abort(self._refused(sanitize_for_message(f'fault in the server: {error!r}', _FAULT_LIMIT)))

    def _begin_again(self) -> None:
        for goal in [goal for goal in self._goals.values() if not goal.active]:
            self._begin(goal.as_accepted())

    def _withdraw(self, goal: ServedGoal) -> None:
        goal.withdraw()
        self._notify_cancel(goal)

    def _notify_cancel(self, goal: ServedGoal) -> None:
        goal.notify_cancel()
        if self._on_cancel is not None:
            self._on_cancel(goal)

    def _cancel(self, handle: ServerGoalHandle) -> CancelResponse:
        goal = self._goals.get(bytes(handle.goal_id.uuid))
        if not self._cancelable or goal is None:
            return CancelResponse.REJECT
        # rclpy makes the goal CANCELING only after this callback.
        self._runtime.post(lambda: self._notify_cancel(goal) if goal.active else None)
        return CancelResponse.ACCEPT


def goal_servers(runtime: Runtime) -> Mapping[str, GoalServer]:
    """Return the goal servers of a node, by the names of their actions. For the executor thread."""
    return MappingProxyType(runtime.once(goal_servers, _no_servers))


def _no_servers(_runtime: Runtime) -> dict[str, GoalServer]:
    return {}


def set_error(result: Any, code: int, message: str) -> None:
    """Fill in what results as those of Nav2 say of an error. (Those of routes have no message.)"""
    result.error_code = code
    if hasattr(result, 'error_msg'):
        result.error_msg = message


def _refusal(action_type: Any, why: str) -> Any:
    result = action_type.Result()
    set_error(result, int(getattr(result, 'UNKNOWN', 0)), why)
    return result


class _Server(ExtendedActionServer):
    """rclpy's server, which keeps results and who waits for them itself. ``on_end`` is told the ID of an ended goal."""

    on_end: Callable[[bytes], object]

    def __init__(self, runtime: Runtime, *arguments: Any, **options: Any) -> None:
        super().__init__(runtime.node, *arguments, execute_callback=_never, result_timeout=_LISTED_SECONDS, **options)
        self.results: dict[bytes, Any] = {}
        self._lengths: dict[bytes, int] = {}
        self._length = 0
        self._runtime = runtime
        self._waiting: dict[bytes, list[Any]] = {}
        self._has_changed = False
        self._holds_cancels = False
        self._held_cancels: deque[Any] = deque(maxlen=MOST_GOALS)

    def begin(self, handle: ServerGoalHandle) -> None:
        self._drop_result(bytes(handle.goal_id.uuid))  # of a goal with the same ID, which is not listed any more
        self.update(handle, GoalEvent.EXECUTE)
        self._list_soon()

    def end(self, handle: ServerGoalHandle, event: GoalEvent, result: Any) -> None:
        goal_id = bytes(handle.goal_id.uuid)
        status = self.update(handle, event)
        if status is None:
            return
        response = self.action_type.Impl.GetResultService.Response(status=status, result=result)
        for request_header in self._waiting.pop(goal_id, ()):
            self.send_result(request_header, response)
        self._keep_result(goal_id, response)
        self._list_soon()
        self.notify_goal_done()
        self._runtime.post_in(RESULT_SECONDS, functools.partial(self._drop_result, goal_id))
        self.on_end(goal_id)

    def destroy(self) -> None:
        self._list()
        super().destroy()

    def hold_cancels(self, is_holding: bool, then: Callable[[], object]) -> None:
        """Do not answer requests to cancel; or answer those that came meanwhile. Then go on."""
        self._holds_cancels = is_holding

        async def answer() -> None:
            while self._held_cancels and not self._holds_cancels:
                await self._execute_cancel_request(self._held_cancels.popleft())
            then()

        if self._held_cancels:
            self._runtime.node.executor.create_task(answer)
        else:
            then()

    async def _execute_cancel_request(self, request_header_and_message: Any) -> None:
        if self._holds_cancels:
            self._held_cancels.append(request_header_and_message)
        else:
            await super()._execute_cancel_request(request_header_and_message)

    def refused_cancel(self, request: Any) -> Any | None:
        asked = request.goal_info
        # With a time, the request is for all goals up to then as well.
        if bytes(asked.goal_id.uuid) not in self.results or asked.stamp != Time():
            return None
        return CancelGoal.Response(return_code=CancelGoal.Response.ERROR_GOAL_TERMINATED)

    def on_result_request(self, request_header: Any, goal_id: bytes) -> None:
        response = self.results.get(goal_id)
        if response is None and self.knows(goal_id):
            self._waiting.setdefault(goal_id, []).append(request_header)
        else:
            unknown = self.action_type.Impl.GetResultService.Response()
            self.send_result(request_header, response or unknown)

    def _keep_result(self, goal_id: bytes, response: Any) -> None:
        self.results[goal_id] = response
        self._lengths[goal_id] = length_of(response.result)
        self._length += self._lengths[goal_id]
        while len(self.results) > MOST_RESULTS or (self._length > RESULTS_LENGTH and len(self.results) > 1):
            self._drop_result(next(iter(self.results)))

    def _drop_result(self, goal_id: bytes) -> None:
        self.results.pop(goal_id, None)
        self._length -= self._lengths.pop(goal_id, 0)

    def _list_soon(self) -> None:
        if not self._has_changed:
            self._has_changed = True
            self._runtime.post_in(_LIST_AFTER_SECONDS, self._list)

    def _list(self) -> None:
        if self._has_changed:
            self._has_changed = False
            self.publish_list()


def _never(handle: ServerGoalHandle) -> None:
    """rclpy demands a callback for the coroutine of a goal, which is never made here."""


class _StockServer(ActionServer):
    """rclpy's server, for which a goal is a coroutine: it waits for :meth:`end`."""

    on_end: Callable[[bytes], object]

    def __init__(self, runtime: Runtime, *arguments: Any, **options: Any) -> None:
        super().__init__(
            runtime.node, *arguments, execute_callback=self._result, result_timeout=RESULT_SECONDS, **options
        )
        self._runtime = runtime
        self._results: dict[bytes, Future] = {}

    def begin(self, handle: ServerGoalHandle) -> None:
        self._results[bytes(handle.goal_id.uuid)] = Future(executor=self._runtime.node.executor)
        handle.execute()

    def end(self, handle: ServerGoalHandle, event: GoalEvent, result: Any) -> None:
        goal_id = bytes(handle.goal_id.uuid)
        {GoalEvent.SUCCEED: handle.succeed, GoalEvent.ABORT: handle.abort, GoalEvent.CANCELED: handle.canceled}[event]()
        self._results[goal_id].set_result(result)
        self.on_end(goal_id)

    def hold_cancels(self, is_holding: bool, then: Callable[[], object]) -> None:
        """rclpy's server answers each cancel at once: here that of a server that hangs is accepted, and has no end."""
        then()

    async def _result(self, handle: ServerGoalHandle) -> Any:
        goal_id = bytes(handle.goal_id.uuid)
        try:
            return await self._results[goal_id]
        finally:
            del self._results[goal_id]
