# SPDX-License-Identifier: BSD-3-Clause
"""Demand for messages about the robot: at once, or only on request."""

from __future__ import annotations

import math
from collections.abc import Callable
from time import monotonic
from typing import Any, Final

from rclpy.qos import QoSProfile

from flexbt_common.calls.goal_server import goal_servers
from flexbt_common.middleware.received_messages import Received, ReceivedMessages
from flexbt_common.runtime.node_runtime import NodeRuntime
from flexbt_common.values.limits import MESSAGE
from flexbt_sim.intra_process import IntraProcessMessages, IntraProcessTopics

LOOK_SECONDS: Final = 0.9
"""Time after which a message is received although nobody needs it, s of wall time. It is less than the time between two
checks of the executor (node_executor.py), so each check receives one."""


class Demand:
    """On the executor thread.

    Poses and scans are needed at once while a goal is active or one of ``reasons`` returns True. At other times they
    would only wake the node, so they stay in the queues of the middleware until :meth:`take`, for LOOK_SECONDS at most.
    The messages received then show whether another node drives the robot.
    """

    def __init__(self, runtime: NodeRuntime, in_process: IntraProcessTopics) -> None:
        self._servers = goal_servers(runtime)
        self._runtime = runtime
        self._in_process = in_process
        self._messages: list[ReceivedMessages | IntraProcessMessages] = []
        self.is_there = False
        """True if messages are handled at once."""
        self.reasons: list[Callable[[], bool]] = []

    def subscribe(
        self, message_type: type[Any], topic: str, qos: QoSProfile, on_message: Callable[[Received], object]
    ) -> None:
        """Call ``on_message`` for messages of a topic, up to the maximum size of a message."""
        node, heard = self._runtime.node, -math.inf

        def hear(received: Received) -> None:
            nonlocal heard
            heard = monotonic()
            on_message(received)

        def is_awaited() -> bool:
            return self._look() or monotonic() - heard >= LOOK_SECONDS

        name = node.resolve_topic_name(topic)
        if self._in_process.is_offered(name, message_type):
            messages = IntraProcessMessages(self._runtime, qos.depth, hear, is_awaited)
            self._in_process.receive(name, message_type, messages.put)
            self._messages.append(messages)
        else:
            self._messages.append(
                ReceivedMessages(node, message_type, topic, qos, hear, MESSAGE, is_awaited=is_awaited)
            )

    def take(self) -> None:
        """Receive the waiting messages for a caller, unless the executor does so anyway."""
        if not self.is_there:
            self.take_all()

    def take_all(self) -> None:
        """Handle the waiting messages now, before any other event."""
        for messages in self._messages:
            messages.take()

    def _look(self) -> bool:
        self.is_there = any(server.busy for server in self._servers.values()) or any(
            reason() for reason in self.reasons
        )
        return self.is_there
