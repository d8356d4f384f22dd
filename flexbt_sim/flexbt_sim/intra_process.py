# SPDX-License-Identifier: BSD-3-Clause
"""Messages between nodes of one process, handed over without the middleware, as rclcpp's intra-process communication.

Poses and scans go from the thread of the world to navigation, and commands back, on one and the same thread where
navigation only waits: neither is sent, and no thread wakes another one. Other subscribers of the topic receive it as
usual.
"""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Final

from rclpy.publisher import Publisher
from rclpy.subscription import Subscription

from flexbt_common.middleware.received_messages import UNKNOWN_WRITER, Received
from flexbt_common.runtime.node_runtime import NodeRuntime

LINGER_SECONDS: Final = 1.0
"""Time for which commands still go through the middleware after its other subscribers are gone, s: an earlier one may
still be on its way there, and must not be overtaken. This is a time, no promise: a command that takes longer comes
after the next one."""

Key = tuple[str, type[Any]]
"""A topic by its full name, and the type of its messages."""


@dataclass(frozen=True)
class _Receiver:
    receive: Callable[[Any], object]
    is_subscribed: bool
    """True if it also receives the messages of the middleware."""


class IntraProcessTopics:
    """The topics that nodes of one process hand over. From any thread."""

    def __init__(self) -> None:
        self._offered: set[Key] = set()
        self._receivers: dict[Key, _Receiver] = {}

    def publisher(self, publisher: Publisher) -> IntraProcessPublisher:
        """Return a replacement of a publisher: receivers in this process get its messages, or bytes."""
        key = publisher.topic_name, publisher.msg_type
        self._offered.add(key)
        return IntraProcessPublisher(publisher, lambda: self._receivers.get(key))

    def withdraw(self, publisher: IntraProcessPublisher) -> None:
        """Undo :meth:`publisher`."""
        self._offered.discard(publisher.key)

    def is_offered(self, topic: str, message_type: type[Any]) -> bool:
        """Return whether a topic, by its full name, has an intra-process publisher."""
        return (topic, message_type) in self._offered

    def receive(self, topic: str, message_type: type[Any], receive: Callable[[Any], object]) -> None:
        """Call ``receive`` with each message of a topic, by its full name, on the thread of the sender."""
        self._receivers[topic, message_type] = _Receiver(receive, is_subscribed=False)

    def receive_instead(self, subscription: Subscription, receive: Callable[[Any], object]) -> None:
        """Do as :meth:`receive` for a subscriber of the topic, which then receives no message twice."""
        self._receivers[subscription.topic_name, subscription.msg_type] = _Receiver(receive, is_subscribed=True)

    def forget(self, subscription: Subscription) -> None:
        """Undo :meth:`receive_instead`."""
        self._receivers.pop((subscription.topic_name, subscription.msg_type), None)


class IntraProcessPublisher:
    """See :meth:`IntraProcessTopics.publisher`."""

    def __init__(self, publisher: Publisher, receiver: Callable[[], _Receiver | None]) -> None:
        self._publisher = publisher
        self._receiver = receiver
        self._sent_until = 0.0

    @property
    def key(self) -> Key:
        """Name of its topic."""
        return self._publisher.topic_name, self._publisher.msg_type

    def get_subscription_count(self) -> int:
        """Return the number of subscribers, in this process and in others."""
        receiver = self._receiver()
        counted: int = self._publisher.get_subscription_count()
        return counted + (receiver is not None and not receiver.is_subscribed)

    def publish(self, message: Any) -> None:
        """Hand a message over, and send it if it has other subscribers."""
        receiver, counted = self._receiver(), self._publisher.get_subscription_count()
        is_subscribed = receiver is not None and receiver.is_subscribed
        is_sent = counted > is_subscribed
        if is_subscribed:
            now = time.monotonic()
            if is_sent:
                self._sent_until = now + LINGER_SECONDS
            is_sent = now < self._sent_until
        if is_sent:
            self._publisher.publish(message)
        if receiver is not None and not (is_sent and is_subscribed):
            receiver.receive(message)


class IntraProcessMessages:
    """The messages handed over on a topic, up to ``depth``, as bytes. ``on_message`` gets them as the executor of
    ``runtime`` would call it, while ``is_awaited()``; otherwise when a receiver takes them.
    """

    def __init__(
        self, runtime: NodeRuntime, depth: int, on_message: Callable[[Received], object], is_awaited: Callable[[], bool]
    ) -> None:
        self._runtime = runtime
        self._on_message = on_message
        self._is_awaited = is_awaited
        self._messages: deque[Received] = deque(maxlen=depth)
        self._is_called = False

    def put(self, data: bytes) -> None:
        """Add a message. From any thread."""
        self._messages.append(Received(data, len(data), UNKNOWN_WRITER, time.time()))
        if not self._is_called:
            self._is_called = True
            self._runtime.run_or_post(self._heed)

    def take(self) -> None:
        """Handle the messages received so far."""
        while self._messages:
            self._on_message(self._messages.popleft())

    def _heed(self) -> None:
        self._is_called = False
        if self._is_awaited():
            self.take()
