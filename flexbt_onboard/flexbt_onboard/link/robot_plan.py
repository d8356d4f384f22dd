# SPDX-License-Identifier: BSD-3-Clause
"""The path that the robot follows: planners publish it once, and a console may come later."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final

from nav_msgs.msg import Path
from rclpy.qos import QoSProfile

from flexbt_common import names
from flexbt_common.runtime import COMPLAINT_SECONDS, NodeRuntime, Received, ReceivedMessages
from flexbt_common.values import fewer_poses, from_entry
from flexbt_msgs.msg import DecisionSubject

MOST_POSES: Final = 500
"""Poses that are passed on: as many as a map on a screen has room for."""

PERIOD: Final = 0.5
"""Seconds from one plan that is passed on to the next: a planner may be quick, and the link slow."""

MOST_BYTES: Final = 2_000_000
"""Of a plan that is passed on: 25,000 poses. To unpack more would hold up everything else."""

MESSAGE_BYTES: Final = 32_000_000


_PATH: Final = 'nav_msgs/msg/Path'


class RobotPlan:
    """Publishes the newest message of a Path topic once more, latched. Used on the executor thread."""

    def __init__(self, runtime: NodeRuntime, topic: str) -> None:
        self._runtime = runtime
        self._publisher = runtime.node.create_publisher(Path, names.EXECUTIVE_PLAN, names.latched())
        self._newest: Received | None = None
        self._due = -math.inf
        self._is_empty = True
        # A planner publishes for whoever is there.
        self._messages = ReceivedMessages(
            runtime.node, Path, topic, QoSProfile(depth=1), self._on_message, MESSAGE_BYTES
        )

    def clear(self) -> None:
        """Forget the plan: another run begins."""
        self._newest = None
        if not self._is_empty:
            self._publish(Path())

    def judged(self, subjects: Sequence[DecisionSubject]) -> None:
        """Take a path that the operator judges as the plan, while none was heard in this run: it was published before
        this process was started, or by nobody."""
        paths = (entry for one in subjects for entry in one.entries if entry.type == _PATH and entry.data)
        if self._is_empty and self._newest is None and (path := next(paths, None)) is not None:
            self._publish(from_entry(path))

    def _on_message(self, received: Received) -> None:
        is_planned, self._newest = self._newest is not None, received
        if not is_planned:
            self._runtime.post_in(max(0.0, self._due - self._runtime.steady.now()), self._pass_on)

    def _pass_on(self) -> None:
        received, self._newest = self._newest, None
        if received is None:
            return
        self._due = self._runtime.steady.now() + PERIOD
        plan = Path()
        try:
            if received.size > MOST_BYTES:
                raise ValueError(f'{received.size} bytes; at most {MOST_BYTES} are shown')
            plan = fewer_poses(received.unpack(Path), MOST_POSES)
        except ValueError as error:
            text = f'{self._messages.subscription.topic_name}: a plan is not shown to operators: {error}'
            self._runtime.node.get_logger().error(text, throttle_duration_sec=COMPLAINT_SECONDS)
        self._publish(plan)  # also an empty one: the plan before is none any more

    def _publish(self, plan: Path) -> None:
        self._is_empty = not plan.poses
        self._publisher.publish(plan)
