# SPDX-License-Identifier: BSD-3-Clause
"""FlexBE's proxy for publishing."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from typing import Any

from rclpy.publisher import Publisher
from rclpy.qos import QoSProfile

from flexbt_core.values import shown
from flexbt_flexbe.errors import ProxyError
from flexbt_onboard.behaviors import RunContext

from .qos import QOS_DEFAULT
from .run_proxy import RunProxy, message_class, on_class_too


@dataclass(frozen=True)
class _Topic:
    message_class: type[Any]
    publisher: Publisher


class _RunPublishers:
    """The publishers of a run, which all its proxies share, as in FlexBE."""

    def __init__(self, run: RunContext) -> None:
        self._runtime = run.services.runtime
        self._topics: dict[str, _Topic] = {}
        run.at_end(self._close)

    def get(self, topic: str) -> _Topic | None:
        return self._topics.get(topic)

    def create(self, topic: str, message: type[Any], qos: QoSProfile | int) -> None:
        known = self._topics.get(topic)
        if known is None:
            publisher = self._runtime.call(lambda: self._runtime.node.create_publisher(message, topic, qos))
            self._topics[topic] = _Topic(message, publisher)
        elif known.message_class is not message:
            raise ProxyError(
                f'topic {topic!r} is published as {known.message_class.__name__} already, not as {message.__name__}'
            )

    def _close(self) -> None:
        topics, self._topics = self._topics, {}
        for topic in topics.values():
            self._runtime.post(partial(self._runtime.node.destroy_publisher, topic.publisher))


class ProxyPublisher(RunProxy):
    """Publishes messages. The topics are those of all proxies of the run."""

    def __init__(
        self,
        topics: Mapping[str, type[Any] | str] | None = None,
        qos: QoSProfile | int | None = None,
        **ignored: Any,
    ) -> None:
        """``ignored`` are options of ROS 1 (``latch``, ``queue_size``); ``qos`` takes their place."""
        super().__init__()
        self._publishers = self._run.shared(_RunPublishers)
        for topic, message in (topics or {}).items():
            self.createPublisher(topic, message, qos)

    @on_class_too
    def createPublisher(
        self, topic: str, msg_type: type[Any] | str, qos: QoSProfile | int | None = None, **ignored: Any
    ) -> None:
        """Publish on a topic from now on.

        Raises:
            ProxyError: no message type, or another than the topic has already.
        """
        self._publishers.create(topic, message_class(topic, msg_type), QOS_DEFAULT if qos is None else qos)

    create_publisher = createPublisher

    @on_class_too
    def remove_publisher(self, topic: str) -> None:
        """A state has done with the topic. The publisher ends with the run: other states may use it."""

    @on_class_too
    def is_available(self, topic: str) -> bool:
        """Whether the run publishes on the topic."""
        return self._publishers.get(topic) is not None

    @on_class_too
    def publish(self, topic: str, msg: Any) -> None:
        """Publish a message.

        Raises:
            ProxyError: the run does not publish on the topic, or the message is of another type.
        """
        known = self._topic(topic)
        if not isinstance(msg, known.message_class):
            raise ProxyError(f'topic {topic!r}: a message is a {known.message_class.__name__}, not {shown(msg)}')
        known.publisher.publish(msg)

    @on_class_too
    def number_of_subscribers(self, topic: str) -> int:
        """How many subscriptions match the publisher, as far as discovery knows."""
        return int(self._topic(topic).publisher.get_subscription_count())

    @on_class_too
    def wait_for_any(self, topic: str, timeout: float = 5.0) -> bool:
        """Whether there is a subscriber now; ``timeout`` is not waited for."""
        return self.number_of_subscribers(topic) > 0

    def _topic(self, topic: str) -> _Topic:
        known = self._publishers.get(topic)
        if known is None:
            raise ProxyError(f'nothing is published on topic {topic!r}; call createPublisher first')
        return known
