# SPDX-License-Identifier: BSD-3-Clause
"""Subscriptions that the leaves of all trees share: made once, kept, so that a new run has the last message at once."""

from __future__ import annotations

import threading
import weakref
from typing import Any

from rclpy.node import Node
from rclpy.qos import QoSProfile

from flexbt_common.runtime import LatestMessage, NodeRuntime
from flexbt_core.behavior_tree import TreeContext


class TopicCache:
    """The last message of a topic. Made on the executor thread."""

    def __init__(self, node: Node, message_type: type[Any], topic: str, qos: QoSProfile | int) -> None:
        self._last = LatestMessage(node, message_type, topic, qos, self._wake)
        self._trees: weakref.WeakSet[TreeContext] = weakref.WeakSet()
        self._lock = threading.Lock()

    @property
    def latest(self) -> Any | None:
        """The last message; None until there is one. From any thread."""
        return self._last.message

    def on_message(self, tree: TreeContext) -> None:
        """Tick the tree whenever a message comes, as long as the tree exists. From any thread."""
        with self._lock:
            self._trees.add(tree)

    def _wake(self) -> None:
        with self._lock:
            trees = tuple(self._trees)
        for tree in trees:
            tree.wake()


class TopicCaches:
    """The caches of a server, by topic and type."""

    def __init__(self, runtime: NodeRuntime) -> None:
        self._runtime = runtime
        self._caches: dict[tuple[str, type[Any]], TopicCache] = {}

    def cache(self, message_type: type[Any], topic: str, qos: QoSProfile | int) -> TopicCache:
        """The cache of a topic, subscribed to when it is asked for the first time. From any thread."""
        return self._runtime.call(lambda: self._cache(message_type, topic, qos))

    def _cache(self, message_type: type[Any], topic: str, qos: QoSProfile | int) -> TopicCache:
        key = (self._runtime.node.resolve_topic_name(topic), message_type)
        if key not in self._caches:
            self._caches[key] = TopicCache(self._runtime.node, message_type, topic, qos)
        return self._caches[key]
