# SPDX-License-Identifier: BSD-3-Clause
"""A topic of which late subscribers get the last messages, and somebody is told when one comes."""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import Any

from rclpy.event_handler import PublisherEventCallbacks
from rclpy.node import Node

from flexbt_common import names


class LatchedTopic:
    """A publisher. ``on_newcomer()`` is called on the executor thread after a subscriber has come.

    Who keeps the numbers of messages knows by :meth:`keeps` which of them newcomers get without more ado.
    """

    def __init__(
        self, node: Node, message_type: type[Any], name: str, depth: int, on_newcomer: Callable[[], None]
    ) -> None:
        self._depth = depth
        self._on_newcomer = on_newcomer
        self._sent = 0
        self._lock = threading.Lock()
        self._publisher = node.create_publisher(
            message_type,
            name,
            names.latched(depth),
            event_callbacks=PublisherEventCallbacks(matched=self._matched, use_default_callbacks=False),
        )

    def publish(self, message: Any) -> int:
        """Send a message, or the serialized form of one. Gives its number. From any thread."""
        with self._lock:
            self._publisher.publish(message)
            self._sent += 1
            return self._sent

    def keeps(self, number: int) -> bool:
        """Whether late subscribers get the message of this number."""
        return self._sent - number < self._depth

    def _matched(self, event: Any) -> None:
        if event.current_count_change > 0:
            self._on_newcomer()
