# SPDX-License-Identifier: BSD-3-Clause
"""The robot's last known pose, as a topic tells it."""

from __future__ import annotations

from collections.abc import Collection

from geometry_msgs.msg import PoseStamped
from rclpy.qos import QoSProfile, ReliabilityPolicy

from flexbt_common.runtime import LatestMessage, NodeRuntime


class RobotPose:
    """The newest message of a PoseStamped topic."""

    def __init__(self, runtime: NodeRuntime, topic: str) -> None:
        self._node = runtime.node
        self._topic = runtime.node.resolve_topic_name(topic)
        qos = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)
        self._pose = LatestMessage(runtime.node, PoseStamped, topic, qos)

    def latest(self) -> PoseStamped:
        """The newest pose; its frame_id is empty while none has come."""
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
