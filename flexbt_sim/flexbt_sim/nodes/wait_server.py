# SPDX-License-Identifier: BSD-3-Clause
"""The action wait: lets time of the node's clock pass. Any number of goals wait at a time."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from typing import Final

from nav2_msgs.action import Wait

from flexbt_common import names
from flexbt_common.calls import GoalServer, ServedGoal
from flexbt_common.runtime import NodeRuntime
from flexbt_common.values import duration_message, seconds_of
from flexbt_core.clock import Timer
from flexbt_sim.server_common import CANCELED, SUCCEEDED, GoalEnd, finish

FEEDBACK_SECONDS: Final = 0.5
"""Time between two feedback messages, s."""


@dataclass(frozen=True)
class _Waiting:
    goal: ServedGoal
    began: float
    alarm: Timer


class WaitServer:
    """On the executor thread."""

    def __init__(self, runtime: NodeRuntime) -> None:
        self._runtime = runtime
        self._waiting: dict[bytes, _Waiting] = {}
        GoalServer(runtime, Wait, names.WAIT, self._serve, lambda goal: self._end(goal.id, CANCELED))

    def end_all(self, end: GoalEnd) -> None:
        """End every goal."""
        for goal_id in list(self._waiting):
            self._end(goal_id, end)

    def _serve(self, goal: ServedGoal) -> None:
        clock = self._runtime.clock
        began = clock.now()
        until = began + seconds_of(goal.request.time)
        alarm = clock.call_at(until, partial(self._end, goal.id, SUCCEEDED))
        self._waiting[goal.id] = _Waiting(goal, began, alarm)
        self._tell_time_left(goal, until)

    def _end(self, goal_id: bytes, end: GoalEnd) -> None:
        waiting = self._waiting.pop(goal_id, None)
        if waiting is None:
            return
        waiting.alarm.cancel()
        elapsed = duration_message(max(0.0, self._runtime.clock.now() - waiting.began))
        finish(waiting.goal, Wait.Result(total_elapsed_time=elapsed), end)

    def _tell_time_left(self, goal: ServedGoal, until: float) -> None:
        if not goal.active:
            return
        clock = self._runtime.clock
        now = clock.now()
        goal.publish_feedback(Wait.Feedback(time_left=duration_message(max(0.0, until - now))))
        if now + FEEDBACK_SECONDS < until:
            clock.call_at(now + FEEDBACK_SECONDS, partial(self._tell_time_left, goal, until))
