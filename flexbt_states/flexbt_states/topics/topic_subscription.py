# SPDX-License-Identifier: BSD-3-Clause
"""The newest message of a topic, for a state."""

from __future__ import annotations

import threading
from typing import Any

from rclpy.qos import QoSProfile
from rclpy.subscription import Subscription

from flexbt_common.runtime import NodeRuntime, qos_misfit
from flexbt_core.state_machine import EventState
from flexbt_onboard.behaviors import state_services


class StateSubscription:
    """Keeps the newest message that came since :meth:`open`, and wakes the state for each.

    Opened and closed on the executor thread in the order of the calls, which come from the thread of the state.
    """

    def __init__(self, state: EventState, topic: str, message_type: type[Any], qos: QoSProfile) -> None:
        self._state = state
        self._topic = topic
        self._message_type = message_type
        self._qos = qos
        self._lock = threading.Lock()
        self._newest: Any | None = None
        self._visit = 0
        self._is_open = False
        self._subscription: Subscription | None = None  # executor thread only

    def open(self) -> None:
        """Start to listen; does nothing when it is open."""
        if self._is_open:
            return
        self._is_open = True
        self._visit += 1
        visit, runtime = self._visit, state_services(self._state).runtime
        runtime.post(lambda: self._subscribe(runtime, visit))

    def close(self) -> None:
        """Stop to listen, and forget the message."""
        if not self._is_open:
            return
        self._is_open = False
        self._visit += 1
        self.take()
        runtime = state_services(self._state).runtime
        runtime.post(lambda: self._unsubscribe(runtime))

    def take(self) -> Any | None:
        """The newest message, once; None when there is none."""
        with self._lock:
            message, self._newest = self._newest, None
        return message

    def lack(self) -> list[str]:
        """Why no message comes, for the operator; empty while nothing is known that is wrong."""
        runtime = state_services(self._state).runtime
        text = qos_misfit(runtime, runtime.node.resolve_topic_name(self._topic)) if self._newest is None else ''
        return [text] if text else []

    def _subscribe(self, runtime: NodeRuntime, visit: int) -> None:
        def receive(message: Any) -> None:
            if visit == self._visit:
                with self._lock:
                    self._newest = message
                self._state.wake()

        self._subscription = runtime.node.create_subscription(self._message_type, self._topic, receive, self._qos)

    def _unsubscribe(self, runtime: NodeRuntime) -> None:
        if self._subscription is not None:
            runtime.node.destroy_subscription(self._subscription)
            self._subscription = None
