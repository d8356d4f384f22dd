# SPDX-License-Identifier: BSD-3-Clause
"""The newest message of a topic, for whoever looks at it far more rarely than it comes."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from rclpy.node import Node
from rclpy.qos import QoSProfile
from rclpy.serialization import deserialize_message


class LatestMessage:
    """Keeps the newest message of a topic as bytes, from which it is made when somebody asks for it.

    Made on the executor thread. ``on_message`` is called there after each message.
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

    def _receive(self, data: bytes) -> None:
        self._newest = data
        self._on_message()
