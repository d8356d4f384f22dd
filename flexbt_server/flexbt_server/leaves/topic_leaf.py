# SPDX-License-Identifier: BSD-3-Clause
"""Leaves that read a topic."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping, Sequence
from typing import Any, ClassVar

from rclpy.qos import QoSProfile

from flexbt_core.behavior_tree import Condition, NodeConfig, NodeStatus, Port, input_port
from flexbt_core.behavior_tree.model import STRING

from .leaf_services import LeafServices
from .topic_cache import SubscribedTopic, TopicCache


class TopicCondition(Condition):
    """Base of conditions on the last message of a topic. A new message ticks the tree.

    ``message_type`` is the class of the messages; the topic is that of the port ``topic_port``, or ``default_topic``.
    """

    __slots__ = ('_cache',)

    message_type: ClassVar[type[Any]]
    default_topic: ClassVar[str] = ''
    topic_port: ClassVar[str] = 'topic_name'
    qos: ClassVar[QoSProfile | int] = 1
    ports: ClassVar[Mapping[str, Port]] = {
        'topic_name': input_port(STRING, optional=True, description="topic, if not the node's default")
    }

    def __init__(self, config: NodeConfig) -> None:
        super().__init__(config)
        self._cache: TopicCache | None = None

    @abstractmethod
    def holds(self, message: Any | None) -> bool:
        """Whether the condition holds; ``message`` is None while nothing was received."""

    @classmethod
    def subscribes_to(cls) -> Sequence[SubscribedTopic]:
        """Its topic, to which the server subscribes when it loads a tree with such a node."""
        return [SubscribedTopic(cls.message_type, cls.default_topic, cls.topic_port, cls.qos)]

    @property
    def is_informed(self) -> bool:
        return self._cache is not None and self._cache.latest is not None

    def tick(self) -> NodeStatus:
        if self._cache is None:
            services: LeafServices = self.services
            (topic,) = self.subscribes_to()
            self._cache = services.topics.cache(topic.of(self))
            self._cache.on_message(self.context)
        message = self._cache.latest
        if self.holds(message):
            return NodeStatus.SUCCESS
        if message is None:
            return self.fail(self._cache.without_message('no message yet'))
        return self.fail('the condition does not hold')
