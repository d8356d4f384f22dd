# SPDX-License-Identifier: BSD-3-Clause
"""Subscriptions shared by the leaves of all trees. They persist, so that a new run has the last message at once."""

from __future__ import annotations

import threading
import weakref
from collections.abc import Iterable, Sequence
from contextlib import suppress
from functools import partial
from itertools import islice
from typing import Any, Final, NamedTuple, Protocol, runtime_checkable

from rclpy.action.server import RCLError
from rclpy.exceptions import InvalidTopicNameException
from rclpy.qos import QoSProfile

from flexbt_common.errors import TopicTypeError
from flexbt_common.middleware.received_messages import LatestMessage
from flexbt_common.runtime.node_runtime import Runtime, qos_misfit
from flexbt_common.runtime.weak_lru_cache import WeakLruCache
from flexbt_core.behavior_tree.engine.context import TreeContext
from flexbt_core.behavior_tree.engine.node import TreeNode

MOST_TOPICS: Final = 100
"""Maximum number of unused subscriptions that are kept."""


class SubscribedTopic(NamedTuple):
    """A topic that nodes of a type subscribe to; its name is in ``port``, or else ``name``. ``qos`` may be a depth."""

    message_type: type[Any]
    name: str
    port: str = ''
    qos: QoSProfile | int = 1

    def of(self, node: TreeNode) -> SubscribedTopic:
        """Return it with the present value of the node's port as its name. Raises PortError, as the port does."""
        given = self.port and node.port_text(self.port) is not None
        name = str(node.get_input(self.port)) if given else ''
        return self._replace(name=name or self.name)


@runtime_checkable
class SubscribesToTopics(Protocol):
    """A node type that subscribes to topics."""

    @classmethod
    def subscribes_to(cls) -> Sequence[SubscribedTopic]: ...


class TopicCache:
    """The last message of a topic. Made on the executor thread; the subscription ends with the owner of the cache."""

    def __init__(self, runtime: Runtime, message_type: type[Any], topic: str, qos: QoSProfile) -> None:
        self._runtime = runtime
        self._topic = runtime.node.resolve_topic_name(topic)
        self._trees: weakref.WeakSet[TreeContext] = weakref.WeakSet()
        self._lock = threading.Lock()
        me = weakref.ref(self)
        self._last = LatestMessage(
            runtime.node, message_type, topic, qos, lambda: _wake(me()), lambda: _is_awaited(me())
        )
        weakref.finalize(self, runtime.post, self._last.close).atexit = False

    @property
    def latest(self) -> Any | None:
        """The last message; None until there is one. From any thread."""
        return self._last.message

    def without_message(self, text: str) -> str:
        """Return ``text`` followed by the reason why no message arrives, if known. From any thread."""
        misfit = qos_misfit(self._runtime, self._topic)
        return f'{text}. {misfit}' if misfit else text

    def on_message(self, tree: TreeContext) -> None:
        """Tick the tree on each message, as long as the tree exists. From any thread."""
        with self._lock:
            self._trees.add(tree)
        self._runtime.post(lambda: None)  # wakes the executor, so that it waits for messages from now on

    @property
    def is_awaited(self) -> bool:
        """True if a tree waits for the topic."""
        return bool(self._trees)

    def wake(self) -> None:
        """Tick those trees."""
        with self._lock:
            trees = tuple(self._trees)
        for tree in trees:
            tree.wake()


def _wake(cache: TopicCache | None) -> None:
    if cache is not None:
        cache.wake()


def _is_awaited(cache: TopicCache | None) -> bool:
    return cache is not None and cache.is_awaited


class TopicCaches:
    """The caches of a server, by topic, type and quality of service."""

    def __init__(self, runtime: Runtime) -> None:
        self._runtime = runtime
        self._caches: WeakLruCache[tuple[str, type[Any], str], TopicCache] = WeakLruCache(MOST_TOPICS)

    def cache(self, topic: SubscribedTopic) -> TopicCache:
        """Return the cache of a topic, and subscribe on first use. From any thread.

        Raises:
            ValueError: the name is not valid for a topic, or the topic has another type.
        """
        return self._runtime.call(lambda: self._cache(topic))

    def subscribe(self, topics: Iterable[SubscribedTopic]) -> None:
        """Subscribe to topics before a leaf reads them, so that earlier messages are known. At most as many as are
        kept. From any thread."""
        wanted = {(topic.message_type, topic.name, str(topic.qos)): topic for topic in topics}
        for topic in islice(wanted.values(), MOST_TOPICS):
            self._runtime.post(partial(self._subscribe, topic))

    def _subscribe(self, topic: SubscribedTopic) -> None:
        with suppress(ValueError):  # the leaf that reads it reports it
            self._cache(topic)

    def _cache(self, topic: SubscribedTopic) -> TopicCache:
        message_type, name, _, qos = topic
        profile = QoSProfile(depth=qos) if isinstance(qos, int) else qos
        try:
            key = (self._runtime.node.resolve_topic_name(name), message_type, str(profile))
            return self._caches.get(key, lambda: TopicCache(self._runtime, message_type, name, profile))
        except TopicTypeError as error:
            raise ValueError(str(error)) from error
        except (RCLError, InvalidTopicNameException) as error:
            raise ValueError(f'no topic can be called {name!r}: {error}') from error
