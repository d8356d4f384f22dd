# SPDX-License-Identifier: BSD-3-Clause
"""FlexBE's proxies for publishers, subscriptions and transforms, with FlexBE's names of quality-of-service
settings."""

from __future__ import annotations

import contextvars
from collections import deque
from collections.abc import Callable, Mapping
from functools import partial
from typing import Any, Final

from rclpy.publisher import Publisher
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rclpy.subscription import Subscription

from flexbt_common.runtime.node_runtime import Runtime, qos_misfit
from flexbt_common.values.value_types import FieldError, exact
from flexbt_core.state_machine.model.event_state import EventState
from flexbt_core.values.text import short_repr
from flexbt_flexbe.errors import ProxyError
from flexbt_onboard.behaviors.run_context import RunContext, current_run

from .run_proxy import Listeners, RunProxy, callable_on_class, message_class


class _RunPublishers:
    """The publishers of a run. As in FlexBE, all its proxies share them."""

    def __init__(self, run: RunContext) -> None:
        self._runtime = run.services.runtime
        self.topics: dict[str, Publisher] = {}
        run.at_end(self._close)

    def create(self, topic: str, message: type[Any], qos: QoSProfile | int) -> None:
        known = self.topics.get(topic)
        if known is None:
            node = self._runtime.node
            self.topics[topic] = self._runtime.call(lambda: node.create_publisher(message, topic, qos))
        elif known.msg_type is not message:
            used = known.msg_type.__name__
            raise ProxyError(f'topic {topic!r} is published as {used} already, not as {message.__name__}')

    def _close(self) -> None:
        topics, self.topics = self.topics, {}
        for publisher in topics.values():
            self._runtime.post(partial(self._runtime.node.destroy_publisher, publisher))


@callable_on_class
class ProxyPublisher(RunProxy):
    """A publisher of messages. All proxies of the run share their topics."""

    def __init__(
        self,
        topics: Mapping[str, type[Any] | str] | None = None,
        qos: QoSProfile | int | None = None,
        **ignored: Any,
    ) -> None:
        """``ignored`` are options of ROS 1 (``latch``, ``queue_size``); ``qos`` replaces them."""
        super().__init__()
        self._publishers = self._run.shared(_RunPublishers)
        for topic, message in (topics or {}).items():
            self.createPublisher(topic, message, qos)

    def createPublisher(
        self, topic: str, msg_type: type[Any] | str, qos: QoSProfile | int | None = None, **ignored: Any
    ) -> None:
        """Create the publisher of a topic.

        Raises:
            ProxyError: the type is not a message type, or the topic already has another type.
        """
        self._publishers.create(topic, message_class(topic, msg_type), QOS_DEFAULT if qos is None else qos)

    create_publisher = createPublisher

    def remove_publisher(self, topic: str) -> None:
        """Do nothing: the publisher ends with the run, since other states may use it."""

    def is_available(self, topic: str) -> bool:
        """Return whether the run publishes on the topic."""
        return topic in self._publishers.topics

    def publish(self, topic: str, msg: Any) -> None:
        """Publish a message.

        Raises:
            ProxyError: the run does not publish on the topic, or the message or a field is of another type.
        """
        publisher = self._topic(topic)
        if not isinstance(msg, publisher.msg_type):
            raise ProxyError(f'topic {topic!r}: a message is a {publisher.msg_type.__name__}, not {short_repr(msg)}')
        try:
            publisher.publish(exact(msg))
        except FieldError as error:
            raise ProxyError(f'topic {topic!r}: {error}') from None

    def number_of_subscribers(self, topic: str) -> int:
        """Return the number of discovered subscriptions that match the publisher."""
        return int(self._topic(topic).get_subscription_count())

    def wait_for_any(self, topic: str, timeout: float = 5.0) -> bool:
        """Return whether a subscriber exists now. It never waits; ``timeout`` has no effect."""
        return self.number_of_subscribers(topic) > 0

    def _topic(self, topic: str) -> Publisher:
        known = self._publishers.topics.get(topic)
        if known is None:
            raise ProxyError(f'nothing is published on topic {topic!r}; call createPublisher first')
        return known


# FlexBE's proxy for subscriptions: keeps the newest message of a topic, or all of them.

MessageCallback = Callable[[Any], None]


class _Feed:
    """The messages of one topic, and the states that wait for them. Messages arrive on the executor thread.

    ``newest`` is the newest message or None; ``buffer`` has all messages, or is None if they are not kept.
    """

    def __init__(self, runtime: Runtime, topic: str, message: type[Any]) -> None:
        self.message_class = message
        self.users: set[Any] = set()
        self.listeners = Listeners()
        self.is_persistent = False
        self._runtime = runtime
        self._topic = topic
        self.newest: Any = None
        self.buffer: deque[Any] | None = None
        self._callbacks: dict[Any, MessageCallback] = {}
        self._subscription: Subscription | None = None  # executor thread only

    def begin(self, qos: QoSProfile | int) -> None:
        """Subscribe, once. Call it when callback and buffer are set: a latched message may come at once."""
        self._runtime.call(lambda: self._subscribe(qos))

    def set_callback(self, user: Any, callback: MessageCallback | None) -> None:
        """Call ``callback`` for each message, in the context of the run."""
        if callback is None:
            self._callbacks.pop(user, None)
        else:
            context = contextvars.copy_context()
            self._callbacks = {**self._callbacks, user: lambda message: context.run(callback, message)}

    def misfit(self) -> str:
        return qos_misfit(self._runtime, self._runtime.node.resolve_topic_name(self._topic))

    def close(self) -> None:
        self._runtime.post(self._unsubscribe)

    def _subscribe(self, qos: QoSProfile | int) -> None:
        if self._subscription is None:
            node = self._runtime.node
            self._subscription = node.create_subscription(self.message_class, self._topic, self._receive, qos)

    def _unsubscribe(self) -> None:
        if self._subscription is not None:
            self._runtime.node.destroy_subscription(self._subscription)
            self._subscription = None

    def _receive(self, message: Any) -> None:
        self.newest = message
        if (buffer := self.buffer) is not None:
            buffer.append(message)
        for callback in tuple(self._callbacks.values()):
            try:
                callback(message)
            except Exception as error:  # code of a state
                self._runtime.report_fault(error, f'a callback of a state for topic {self._topic!r}')
        self.listeners.wake()


class _RunFeeds:
    """The subscriptions of a run. As in FlexBE, all its proxies share them."""

    def __init__(self, run: RunContext) -> None:
        self._runtime = run.services.runtime
        self.feeds: dict[str, _Feed] = {}
        run.at_end(self._close)

    def open(self, topic: str, message: type[Any]) -> _Feed:
        feed = self.feeds.get(topic)
        if feed is None:
            feed = self.feeds[topic] = _Feed(self._runtime, topic, message)
        elif feed.message_class is not message:
            raise ProxyError(
                f'topic {topic!r} is subscribed as {feed.message_class.__name__} already, not as {message.__name__}'
            )
        return feed

    def lacks(self, state: EventState) -> list[str]:
        """Return why no message arrives on topics that a state has requested and has no message of."""
        asked = (feed for feed in self.feeds.values() if feed.newest is None and feed.listeners.has(state))
        return [text for feed in asked if (text := feed.misfit())]

    def drop(self, topic: str) -> None:
        feed = self.feeds.pop(topic, None)
        if feed is not None:
            feed.close()

    def _close(self) -> None:
        for topic in tuple(self.feeds):
            self.drop(topic)


@callable_on_class
class ProxySubscriberCached(RunProxy):
    """A subscriber to topics. All proxies of the run share the messages; states that requested one are woken."""

    def __init__(
        self,
        topics: Mapping[str, type[Any] | str] | None = None,
        qos: QoSProfile | int | None = None,
        inst_id: Any = None,
    ) -> None:
        super().__init__()
        self._feeds = self._run.shared(_RunFeeds)
        for topic, message in (topics or {}).items():
            self.subscribe(topic, message, qos=qos, inst_id=inst_id)

    def subscribe(
        self,
        topic: str,
        msg_type: type[Any] | str,
        callback: MessageCallback | None = None,
        buffered: bool = False,
        qos: QoSProfile | int | None = None,
        inst_id: Any = None,
    ) -> None:
        """Subscribe to a topic, until every subscribed ``inst_id`` has called :meth:`unsubscribe_topic`; None is this
        proxy. Each has its own callback.

        Raises:
            ProxyError: the type is not a message type, or the run has subscribed to the topic with another type.
            TopicTypeError: the topic has another type.
            InvalidTopicNameException: no topic can have that name.
        """
        feed = self._feeds.open(topic, message_class(topic, msg_type))
        feed.users.add(self._user(inst_id))
        if callback is not None:
            feed.set_callback(self._user(inst_id), callback)
        if buffered:
            self.enable_buffer(topic)
        try:
            feed.begin(QOS_DEFAULT if qos is None else qos)
        except Exception:
            self.unsubscribe_topic(topic, inst_id)
            raise

    def set_callback(self, topic: str, callback: MessageCallback | None, inst_id: Any = None) -> None:
        """Set a callback for each message. It runs on the executor's thread and must not block."""
        self._feed(topic).set_callback(self._user(inst_id), callback)

    def enable_buffer(self, topic: str) -> None:
        """Keep all messages from now on."""
        feed = self._feed(topic)
        if feed.buffer is None:  # an empty one may be about to get a message
            feed.buffer = deque()

    def disable_buffer(self, topic: str) -> None:
        """Keep the newest message only."""
        self._feed(topic).buffer = None

    def is_available(self, topic: str) -> bool:
        """Return whether the run subscribes to the topic."""
        return self._asked(topic) is not None

    def has_msg(self, topic: str) -> bool:
        """Return whether a message has arrived and was not removed."""
        return self.get_last_msg(topic) is not None

    def get_last_msg(self, topic: str) -> Any:
        """Return the newest message or None."""
        feed = self._asked(topic)
        return feed.newest if feed is not None else None

    def has_buffered(self, topic: str) -> bool:
        """Return whether the buffer has messages."""
        feed = self._asked(topic)
        return feed is not None and bool(feed.buffer)

    def get_from_buffer(self, topic: str) -> Any:
        """Remove and return the oldest message of the buffer; None if it is empty."""
        feed = self._asked(topic)
        return feed.buffer.popleft() if feed is not None and feed.buffer else None

    def peek_at_buffer(self, topic: str) -> Any:
        """Return the oldest message of the buffer without removing it."""
        feed = self._asked(topic)
        return feed.buffer[0] if feed is not None and feed.buffer else None

    def remove_last_msg(self, topic: str, clear_buffer: bool = False) -> None:
        """Drop the newest message, unless the topic is persistent."""
        feed = self._asked(topic)
        if feed is not None:
            if not feed.is_persistent:
                feed.newest = None
            if clear_buffer and feed.buffer is not None:
                feed.buffer.clear()

    def make_persistant(self, topic: str) -> None:
        """Make the topic persistent: :meth:`remove_last_msg` then keeps the newest message."""
        self._feed(topic).is_persistent = True

    make_persistent = make_persistant

    def unsubscribe_topic(self, topic: str, inst_id: Any = None) -> None:
        """Unsubscribe ``inst_id``; the last one ends the subscription."""
        feed = self._feeds.feeds.get(topic)
        if feed is not None:
            feed.set_callback(self._user(inst_id), None)
            feed.users.discard(self._user(inst_id))
            if not feed.users:
                self._feeds.drop(topic)

    def _user(self, inst_id: Any) -> Any:
        return self if inst_id is None else inst_id

    def _feed(self, topic: str) -> _Feed:
        feed = self._feeds.feeds.get(topic)
        if feed is None:
            raise ProxyError(f'topic {topic!r} is not subscribed; call subscribe first')
        return feed

    def _asked(self, topic: str) -> _Feed | None:
        feed = self._feeds.feeds.get(topic)
        if feed is not None:
            feed.listeners.note_caller()
        return feed


def lacks_of(state: EventState) -> list[str]:
    """Return why no message arrives on requested topics of a state, for the operator. On the thread of the run."""
    return current_run().shared(_RunFeeds).lacks(state)


# FlexBE's proxy for transforms.


class _RunTransforms:
    """The buffer and the listener of a run."""

    def __init__(self, run: RunContext) -> None:
        try:
            import tf2_ros
        except ImportError as error:
            raise ProxyError(f'transforms need the package tf2_ros: {error}') from None
        runtime = run.services.runtime
        self.buffer: Any = tf2_ros.Buffer()
        self.listener: Any = runtime.call(
            lambda: tf2_ros.TransformListener(self.buffer, runtime.node, spin_thread=False)
        )
        run.at_end(lambda: runtime.call(self.listener.unregister))


class ProxyTransformListener(RunProxy):
    """A listener to transforms from its creation on. ``buffer.lookup_transform`` without a timeout does not wait."""

    def __init__(self) -> None:
        super().__init__()
        self._transforms = self._run.shared(_RunTransforms)

    @property
    def listener(self) -> Any:
        """The listener of tf2_ros."""
        return self._transforms.listener

    @property
    def buffer(self) -> Any:
        """The buffer of tf2_ros."""
        return self._transforms.buffer


# Quality-of-service settings, under FlexBE's names.

QOS_DEFAULT: Final = QoSProfile(depth=10)
QOS_LATCH: Final = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
QOS_LOSSY: Final = QoSProfile(depth=10, reliability=ReliabilityPolicy.BEST_EFFORT)
