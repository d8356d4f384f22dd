# SPDX-License-Identifier: BSD-3-Clause
"""A real action server whose goals end as a test decides; also a program, which serves ``wait``.

The program, ``scripted``, prints a line for each goal and each cancel, and has a service ``held`` that never answers.
With the argument ``token`` it holds a liveliness token. With ``stubborn`` it does not end canceled goals.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Awaitable, Callable
from typing import Any, Final

from nav2_msgs.action import Wait
from rclpy.action import ActionServer, CancelResponse, GoalResponse
from rclpy.action.server import ServerGoalHandle
from rclpy.task import Future
from std_srvs.srv import Trigger

from flexbt_common.lifecycle.liveliness import LivelinessToken
from flexbt_common.names import service_qos
from flexbt_common.runtime.node_runtime import NodeRuntime, run_node
from flexbt_testing.waiting import wait_until

GoalScript = Callable[[ServerGoalHandle], Awaitable[Any]]
"""A script of a goal: it ends the goal through its handle and returns the result. It may await :meth:`future`."""

GoalAnswer = Callable[[int, Any], 'tuple[str, Any] | None']
"""A function that returns the end of goal number n: ``succeed`` or ``abort`` and the result; None holds the goal."""

DEEP_QUEUES: Final = {
    'goal_service_qos_profile': service_qos(),
    'result_service_qos_profile': service_qos(),
    'cancel_service_qos_profile': service_qos(),
}
"""Arguments of rclpy's ``ActionClient`` and ``ActionServer`` that prevent the loss of goals in a burst."""

_HOW: Final = {4: 'succeed', 5: 'canceled', 6: 'abort'}  # action_msgs/GoalStatus


def ends(result: Any, how: str = 'succeed') -> GoalScript:
    """Return a script that ends each goal at once, by ``succeed`` or ``abort``."""

    async def script(handle: ServerGoalHandle) -> Any:
        getattr(handle, how)()
        return result

    return script


class ScriptedActionServer:
    """An action server on a node. ``script`` or ``answer`` decides the end of a goal.

    Without them, a goal is held until :meth:`end`, until it is canceled or, if ``preempting``, until a newer one
    arrives.
    """

    def __init__(
        self,
        runtime: NodeRuntime,
        action_type: Any,
        name: str,
        script: GoalScript | None = None,
        *,
        answer: GoalAnswer = lambda _number, _goal: None,
        accept: Callable[[Any], object] = lambda _goal: True,
        on_cancel: Callable[[ServerGoalHandle], CancelResponse] | None = None,
        server_class: Any = ActionServer,
    ) -> None:
        self.runtime = runtime
        self.accept = accept
        self.on_cancel = on_cancel
        self.answer = answer
        self.preempting = False
        self.delay_accept = 0.0
        """Duration of the acceptance, s; it blocks the server's executor."""
        self.delay_cancel = 0.0
        """Time between a cancel and the end of a held goal, s."""
        self.goals: list[Any] = []
        """Requests, in the order of acceptance."""
        self.statuses: dict[int, str] = {}
        """End of each goal by number: succeed, abort, canceled."""
        self.cancels = 0
        self._action_type = action_type
        self._script = script
        self._handles: list[ServerGoalHandle] = []
        self._ends: list[Future] = []
        self.server = runtime.call(
            lambda: server_class(
                runtime.node,
                action_type,
                name,
                execute_callback=self._execute,
                goal_callback=self._goal,
                cancel_callback=self._cancel,
                result_timeout=10,
                **DEEP_QUEUES,
            )
        )

    @property
    def running(self) -> list[int]:
        """Numbers of the running goals."""
        return [number for number in range(len(self.goals)) if number not in self.statuses]

    def forget(self) -> None:
        """Restart the count. No goal may be running."""
        for known in (self.goals, self.statuses, self._handles, self._ends):
            known.clear()

    def end(self, number: int, how: str = 'succeed', result: Any = None) -> None:
        """End a held goal. Wait until the goal exists."""
        wait_until(lambda: len(self.goals) > number, f'goal {number}')
        self.runtime.post(lambda: self._end(number, how, result))

    def feedback(self, number: int, message: Any) -> None:
        """Publish feedback of a goal."""
        self.runtime.post(lambda: self._handles[number].publish_feedback(message))

    def future(self) -> Future:
        """Return a future for a script to await."""
        return self.runtime.call(Future)

    def resolve(self, future: Future) -> None:
        """Complete the future so that a script continues."""
        self.runtime.post(lambda: None if future.done() else future.set_result(None))

    def _end(self, number: int, how: str, result: Any = None) -> None:
        if not self._ends[number].done():
            self._ends[number].set_result((how, result if result is not None else self._action_type.Result()))

    def _goal(self, goal: Any) -> GoalResponse:
        time.sleep(self.delay_accept)
        return GoalResponse.ACCEPT if self.accept(goal) else GoalResponse.REJECT

    def _cancel(self, handle: ServerGoalHandle) -> CancelResponse:
        self.cancels += 1
        if self.on_cancel is not None:
            return self.on_cancel(handle)
        if handle in self._handles:
            number = self._handles.index(handle)
            self.runtime.post_in(self.delay_cancel, lambda: self._end(number, 'canceled'))
        return CancelResponse.ACCEPT

    async def _execute(self, handle: ServerGoalHandle) -> Any:
        number = len(self.goals)
        self._ends.append(Future(executor=self.runtime.node.executor))
        self._handles.append(handle)
        self.goals.append(handle.request)  # last: an observer of the goal may end it
        try:
            return await (self._script(handle) if self._script is not None else self._answered(number, handle))
        finally:
            self.statuses[number] = _HOW.get(handle.status, 'unknown')

    async def _answered(self, number: int, handle: ServerGoalHandle) -> Any:
        if self.preempting:
            for older in self.running[:-1]:
                self._end(older, 'abort')
        answer = self.answer(number, handle.request)
        if answer is None and handle.is_cancel_requested:  # canceled before the goal could be ended
            self._end(number, 'canceled')
        how, result = answer if answer is not None else await self._ends[number]
        getattr(handle, how)()
        return result


class _TellingServer(ScriptedActionServer):
    """A server that prints its requests."""

    def _goal(self, goal: Any) -> GoalResponse:
        print('goal', flush=True)
        return super()._goal(goal)

    def _cancel(self, handle: ServerGoalHandle) -> CancelResponse:
        print('cancel', flush=True)
        return super()._cancel(handle)


def main() -> int:
    """Serve ``wait`` until the process is stopped."""

    async def never(_request: Any, _response: Any) -> Any:
        await Future()

    def setup(runtime: NodeRuntime) -> None:
        server = _TellingServer(runtime, Wait, 'wait')
        if 'stubborn' in sys.argv:
            server.delay_cancel = 1e6
        if 'token' in sys.argv:
            LivelinessToken(runtime).set_ready(True)
        runtime.call(lambda: runtime.node.create_service(Trigger, 'held', never))
        runtime.on_close(server.server.destroy)
        print('ready', flush=True)

    return run_node('scripted', setup, [])


if __name__ == '__main__':
    sys.exit(main())
