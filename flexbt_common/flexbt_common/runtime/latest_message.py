# SPDX-License-Identifier: BSD-3-Clause
"""The newest message of a topic, for whoever reads it far more rarely than it comes."""

from __future__ import annotations

import threading
from collections.abc import Callable, Mapping
from typing import Any, Final

from geometry_msgs.msg import PoseStamped
from rclpy.exceptions import InvalidHandle
from rclpy.node import Node
from rclpy.qos import QoSProfile
from rclpy.serialization import deserialize_message
from rclpy.subscription import Subscription

from flexbt_common.values import MESSAGE

from .rclpy_private import EXECUTOR, is_usable
from .received_messages import COMPLAINT_SECONDS

MOST_BYTES: Final[Mapping[type[Any], int]] = {PoseStamped: 2_000}
"""Of types whose messages are handed on again and again; of others, as many as a message may have at all."""


class LatestMessage:
    """Keeps the newest message of a topic as bytes, from which it is made when somebody asks for it.

    Made and closed on the executor thread. While ``is_awaited()``, by default never, the executor takes what comes and
    calls ``on_message``; otherwise a message stays with the middleware until somebody asks. One of more bytes than
    MOST_BYTES says is left aside.
    """

    def __init__(
        self,
        node: Node,
        message_type: type[Any],
        topic: str,
        qos: QoSProfile | int,
        on_message: Callable[[], object] = lambda: None,
        is_awaited: Callable[[], bool] = lambda: False,
    ) -> None:
        self._type = message_type
        self._on_message = on_message
        self._is_awaited = is_awaited
        self._newest: bytes | None = None
        self._made: tuple[bytes, Any] | None = None
        self._node = node
        self._most = MOST_BYTES.get(message_type, MESSAGE)
        self._lock = threading.Lock()
        self._takes = is_usable(EXECUTOR)  # otherwise rclpy's executor does, always
        self._subscription = node.create_subscription(message_type, topic, self._callback(), qos, raw=True)

    @property
    def message(self) -> Any | None:
        """The newest message, the same object until there is a newer one; None before the first. From any thread."""
        if self._takes:
            self._take_all(self._subscription)
        newest, made = self._newest, self._made
        if newest is None:
            return None
        if made is None or made[0] is not newest:
            made = self._made = (newest, deserialize_message(newest, self._type))
        return made[1]

    def close(self) -> None:
        """Hear no more."""
        self._node.destroy_subscription(self._subscription)

    def _callback(self) -> Callable[[bytes], None]:
        def callback(data: bytes) -> None:
            """For the executor of rclpy, which has taken the message."""
            self._keep(data)
            if self._is_awaited():
                self._on_message()

        callback.take_all = self._take_all  # type: ignore[attr-defined]  # see rclpy_private.OpenExecutor
        callback.is_awaited = self._is_awaited  # type: ignore[attr-defined]  # see node_executor.NodeExecutor
        return callback

    def _take_all(self, subscription: Subscription) -> None:
        has_come = False
        with self._lock:  # what is taken last is the newest
            try:
                with subscription.handle:
                    while (taken := subscription.handle.take_message(self._type, True)) is not None:
                        self._keep(taken[0])
                        has_come = True
            except InvalidHandle:
                return  # closed
        if has_come and self._is_awaited():
            self._on_message()

    def _keep(self, data: bytes) -> None:
        if len(data) <= self._most:
            self._newest = data
            return
        self._node.get_logger().error(
            f'{self._subscription.topic_name}: a message of {len(data)} bytes is left aside; at most {self._most} '
            'are allowed',
            throttle_duration_sec=COMPLAINT_SECONDS,
        )
