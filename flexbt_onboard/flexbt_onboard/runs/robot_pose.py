# SPDX-License-Identifier: BSD-3-Clause
"""The robot's last known pose, as a topic tells it."""

from __future__ import annotations

from geometry_msgs.msg import PoseStamped
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rclpy.serialization import deserialize_message

from flexbt_common.runtime import NodeRuntime


class RobotPose:
    """Keeps the newest message of a PoseStamped topic as bytes: it is read far more rarely than it comes."""

    def __init__(self, runtime: NodeRuntime, topic: str) -> None:
        self._data: bytes | None = None
        qos = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)
        self._subscription = runtime.node.create_subscription(PoseStamped, topic, self._receive, qos, raw=True)

    def latest(self) -> PoseStamped:
        """The newest pose; its frame_id is empty while none has come."""
        return PoseStamped() if self._data is None else deserialize_message(self._data, PoseStamped)

    def _receive(self, data: bytes) -> None:
        self._data = data
