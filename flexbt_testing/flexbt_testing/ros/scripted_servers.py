# SPDX-License-Identifier: BSD-3-Clause
"""Real action and service servers whose behavior a test scripts; also runnable as a process of its own."""

from __future__ import annotations

import sys
import threading
from collections.abc import Callable
from typing import Any

from nav2_msgs.action import Wait
from rclpy.action import ActionServer, CancelResponse, GoalResponse
from rclpy.task import Future

from flexbt_common.names import deep_action_services
from flexbt_common.runtime import NodeRuntime, run_node


class ScriptedServer:
    """A Wait server on ``name``. Each goal runs until :meth:`end` is called, or until it is canceled.

    ``delay_accept``: an event that acceptance waits for (the executor of this server is blocked meanwhile).
    """

    def __init__(self, runtime: NodeRuntime, name: str = 'wait') -> None:
        self.runtime = runtime
        self.goals: list[Any] = []
        self.changed = threading.Condition()
        self.accept: Callable[[Any], bool] = lambda goal: True
        self.accept_cancel = True
        self.delay_accept: threading.Event | None = None
        self.ends: list[Any] = []
        self.canceled = 0
        self.statuses: list[str] = []
        self.server = runtime.call(
            lambda: ActionServer(
                runtime.node,
                Wait,
                name,
                execute_callback=self._execute,
                goal_callback=self._goal,
                cancel_callback=self._cancel,
                result_timeout=10,
                **deep_action_services(),
            )
        )

    def _goal(self, goal: Any) -> GoalResponse:
        if self.delay_accept is not None:
            self.delay_accept.wait(10.0)
        return GoalResponse.ACCEPT if self.accept(goal) else GoalResponse.REJECT

    def _cancel(self, handle: Any) -> CancelResponse:
        self.canceled += 1
        if not self.accept_cancel:
            return CancelResponse.REJECT
        self.runtime.post(lambda: self.ends[self.goals.index(handle)].set_result('canceled'))
        return CancelResponse.ACCEPT

    async def _execute(self, handle: Any) -> Any:
        end: Any = Future()
        with self.changed:
            self.ends.append(end)
            self.goals.append(handle)
            self.changed.notify_all()
        how = await end
        getattr(handle, how)()
        with self.changed:
            self.statuses.append(how)
            self.changed.notify_all()
        return Wait.Result(error_msg='' if how == 'succeed' else f'scripted {how}')

    def wait_until(self, condition: Callable[[], bool], timeout: float = 10.0) -> None:
        with self.changed:
            assert self.changed.wait_for(condition, timeout), 'the server did not get there'

    def end(self, index: int, how: str = 'succeed') -> None:
        """End goal number ``index`` by ``succeed``, ``abort`` or (after a cancel) ``canceled``."""
        self.wait_until(lambda: len(self.goals) > index)
        self.runtime.post(lambda: self.ends[index].set_result(how))

    def feedback(self, index: int, seconds: int) -> None:
        message = Wait.Feedback()
        message.time_left.sec = seconds
        self.runtime.post(lambda: self.goals[index].publish_feedback(message))


def main() -> int:
    def setup(runtime: NodeRuntime) -> None:
        server = ScriptedServer(runtime)
        runtime.on_close(server.server.destroy)
        print('ready', flush=True)

    return run_node('scripted', setup, [])


if __name__ == '__main__':
    sys.exit(main())
