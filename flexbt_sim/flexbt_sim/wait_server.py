# SPDX-License-Identifier: BSD-3-Clause
"""The action wait: lets time of the node's clock pass. Any number of goals wait at a time."""

from __future__ import annotations

from functools import partial
from typing import Any, Final

from rclpy.action import ActionServer, CancelResponse
from rclpy.action.server import ServerGoalHandle
from rclpy.task import Future

from flexbt_common import names
from flexbt_common.node_runtime import NodeRuntime
from flexbt_sim.action_results import CANCELED, RESULT_TIMEOUT, SUCCEEDED, GoalEnd, finish
from flexbt_sim.ros_messages import duration_message, seconds_of

FEEDBACK_SECONDS: Final = 0.5
"""Time between two feedback messages, s."""


class WaitServer:
    """On the executor thread."""

    def __init__(self, runtime: NodeRuntime, action_type: Any) -> None:
        self._runtime = runtime
        self._action_type = action_type
        self._waiting: dict[bytes, Future] = {}
        server = ActionServer(
            runtime.node,
            action_type,
            names.WAIT,
            self._execute,
            cancel_callback=self._on_cancel,
            result_timeout=RESULT_TIMEOUT,
            **names.deep_action_services(),
        )
        runtime.on_close(lambda: runtime.call(server.destroy))

    @property
    def busy(self) -> bool:
        """Whether anybody waits."""
        return bool(self._waiting)

    def end_all(self, end: GoalEnd) -> None:
        """End every goal."""
        for future in self._waiting.values():
            _resolve(future, end)

    async def _execute(self, handle: ServerGoalHandle) -> Any:
        clock = self._runtime.clock
        began = clock.now()
        until = began + seconds_of(handle.request.time)
        over = Future(executor=self._runtime.node.executor)
        if handle.is_cancel_requested:
            _resolve(over, CANCELED)
        key = bytes(handle.goal_id.uuid)
        self._waiting[key] = over
        alarm = clock.call_at(until, partial(_resolve, over, SUCCEEDED))
        self._tell_time_left(handle, until)
        end = await over
        alarm.cancel()
        del self._waiting[key]
        elapsed = duration_message(max(0.0, clock.now() - began))
        return finish(handle, self._action_type.Result(total_elapsed_time=elapsed), end)

    def _tell_time_left(self, handle: ServerGoalHandle, until: float) -> None:
        if not handle.is_active:
            return
        clock = self._runtime.clock
        now = clock.now()
        handle.publish_feedback(self._action_type.Feedback(time_left=duration_message(max(0.0, until - now))))
        if now + FEEDBACK_SECONDS < until:
            clock.call_at(now + FEEDBACK_SECONDS, partial(self._tell_time_left, handle, until))

    def _on_cancel(self, handle: ServerGoalHandle) -> CancelResponse:
        over = self._waiting.get(bytes(handle.goal_id.uuid))
        if over is not None:
            # rclpy makes the goal CANCELING only after this callback.
            self._runtime.post(partial(_resolve, over, CANCELED))
        return CancelResponse.ACCEPT


def _resolve(future: Future, end: GoalEnd) -> None:
    if not future.done():
        future.set_result(end)
