# SPDX-License-Identifier: BSD-3-Clause
"""The robot as operators see it: its last known pose, and the path that it follows."""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence
from typing import Final

from geometry_msgs.msg import PoseStamped
from nav_msgs.msg import Path
from rclpy.qos import QoSProfile, ReliabilityPolicy

from flexbt_common import names
from flexbt_common.middleware.received_messages import COMPLAINT_SECONDS, LatestMessage, Received, ReceivedMessages
from flexbt_common.runtime.node_runtime import Runtime
from flexbt_common.values.message_fields import path_points
from flexbt_msgs.msg import DecisionSubject
from flexbt_msgs.msg import RobotPlan as RobotPlanMessage


class RobotPose:
    """The newest message of a PoseStamped topic."""

    def __init__(self, runtime: Runtime, topic: str) -> None:
        self._node = runtime.node
        self._topic = runtime.node.resolve_topic_name(topic)
        qos = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)
        self._pose = LatestMessage(runtime.node, PoseStamped, topic, qos)

    def latest(self) -> PoseStamped:
        """Return the newest pose; its frame_id is empty while none has come."""
        return self._pose.message or PoseStamped()

    def problem(self, gone: Collection[str] = ()) -> str:
        """Why the newest pose is not known, or may not be the present one; '' when somebody tells it.

        Nodes that are ``gone`` tell nothing, though the middleware misses one that was killed only after its lease.
        """
        is_told = self._node.count_publishers(self._topic) > 0
        if is_told and gone:
            publishers = self._node.get_publishers_info_by_topic(self._topic)
            is_told = any(f'{one.node_namespace.rstrip("/")}/{one.node_name}' not in gone for one in publishers)
        if self._pose.message is None:
            return f'nothing came on {self._topic} yet' if is_told else f'nobody publishes {self._topic}'
        return '' if is_told else f'nobody publishes {self._topic} any more'


# The path that the robot follows: planners publish it once, and a console may come later.

MOST_POINTS: Final = 500
"""Points that are passed on: as many as a map on a screen has room for."""

PERIOD: Final = 0.5
"""Seconds from one plan that is passed on to the next: a planner may be quick, and the link slow."""

MOST_BYTES: Final = 4_000_000
"""Maximum size of a plan that is passed on, bytes: 50,000 poses. Reading more would delay everything else."""

MESSAGE_BYTES: Final = 32_000_000

_PATH: Final = 'nav_msgs/msg/Path'


class RobotPlan:
    """A publisher that repeats the newest message of a Path topic, latched. Used on the executor thread."""

    def __init__(self, runtime: Runtime, topic: str) -> None:
        self._runtime = runtime
        self._publisher = runtime.node.create_publisher(
            RobotPlanMessage, names.EXECUTIVE_PLAN, names.transient_local_qos()
        )
        self._newest: Received | None = None
        self._due = -math.inf
        self._is_empty = True
        self._is_judged = False
        # A planner publishes for the subscribers of the moment.
        self._messages = ReceivedMessages(
            runtime.node, Path, topic, QoSProfile(depth=1), self._on_message, MESSAGE_BYTES
        )

    def clear(self) -> None:
        """Forget the plan: another run begins."""
        self._newest = None
        if not self._is_empty:
            self._publish(b'')

    def judged(self, subjects: Sequence[DecisionSubject]) -> None:
        """Take the path that the operator judges as the plan, while none was heard in this run: it was published before
        this process was started, or by nobody. It takes the place of one that was judged before."""
        paths = (entry.data for one in subjects for entry in one.entries if entry.type == _PATH and entry.data)
        is_unheard = (self._is_empty or self._is_judged) and self._newest is None
        if is_unheard and (path := next(paths, None)) is not None:
            self._publish(bytes(path))
            self._is_judged = True

    def _on_message(self, received: Received) -> None:
        is_planned, self._newest = self._newest is not None, received
        if not is_planned:
            self._runtime.post_in(max(0.0, self._due - self._runtime.steady.now()), self._pass_on)

    def _pass_on(self) -> None:
        received, self._newest = self._newest, None
        if received is None:
            return
        self._due = self._runtime.steady.now() + PERIOD
        self._is_judged = False
        if received.data is not None and received.size <= MOST_BYTES:
            self._publish(received.data)
        else:
            self._publish(b'', f'{received.size} bytes; at most {MOST_BYTES} are shown')

    def _publish(self, path: bytes, problem: str = '') -> None:
        """Publish the points of a serialized path. Where there are none, the plan before is none any more."""
        frame, points = '', list[tuple[float, float]]()
        try:
            frame, points = path_points(path, MOST_POINTS) if path else ('', [])
            if not all(math.isfinite(x) and math.isfinite(y) for x, y in points):
                points, problem = [], 'a point that is nowhere'
        except ValueError as error:
            problem = str(error)
        if problem:
            text = f'{self._messages.subscription.topic_name}: a plan is not shown to operators: {problem}'
            self._runtime.node.get_logger().error(text, throttle_duration_sec=COMPLAINT_SECONDS)
        self._is_empty = not points
        across, up = zip(*points, strict=True) if points else ((), ())
        self._publisher.publish(RobotPlanMessage(frame_id=frame if points else '', x=across, y=up))
