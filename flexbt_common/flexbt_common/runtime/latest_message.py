# SPDX-License-Identifier: BSD-3-Clause
"""The newest message of a topic, for whoever reads it far more rarely than it comes."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, Final

from geometry_msgs.msg import PoseStamped
from rclpy.node import Node
from rclpy.qos import QoSProfile
from rclpy.serialization import deserialize_message

from flexbt_common.values import MESSAGE

MOST_BYTES: Final[Mapping[type[Any], int]] = {PoseStamped: 2_000}
"""Of types whose messages are handed on again and again; of others, as many as a message may have at all."""


class LatestMessage:
    """Keeps the newest message of a topic as bytes, from which it is made when somebody asks for it.

    Made and closed on the executor thread. ``on_message`` is called there after each message. One of more bytes than
    MOST_BYTES says is left aside.
    """

    def __init__(
        self,
        node: Node,
        message_type: type[Any],
        topic: str,
        qos: QoSProfile | int,
        on_message: Callable[[], object] = lambda: None,
    ) -> None:
        self._type = message_type
        self._on_message = on_message
        self._newest: bytes | None = None
        self._made: tuple[bytes, Any] | None = None
        self._node = node
        self._most = MOST_BYTES.get(message_type, MESSAGE)
        self._subscription = node.create_subscription(message_type, topic, self._receive, qos, raw=True)

    @property
    def message(self) -> Any | None:
        """The newest message, the same object until there is a newer one; None before the first. From any thread."""
        newest, made = self._newest, self._made
        if newest is None:
            return None
        if made is None or made[0] is not newest:
            made = self._made = (newest, deserialize_message(newest, self._type))
        return made[1]

    def close(self) -> None:
        """Hear no more."""
        self._node.destroy_subscription(self._subscription)

    def _receive(self, data: bytes) -> None:
        if len(data) > self._most:
            self._node.get_logger().error(
                f'{self._subscription.topic_name}: a message of {len(data)} bytes is left aside; at most {self._most} '
                'are allowed',
                throttle_duration_sec=5.0,
            )
            return
        self._newest = data
        self._on_message()
