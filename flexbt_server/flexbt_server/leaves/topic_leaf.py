# SPDX-License-Identifier: BSD-3-Clause
"""Bases of leaves that read a topic, and of leaves that use poses. On an unknown value they fail with the reason."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping, Sequence
from typing import Any, ClassVar

from geometry_msgs.msg import PoseStamped
from rclpy.qos import QoSProfile

from flexbt_common.errors import TransformError
from flexbt_core.behavior_tree.engine.leaf import Condition, LeafNode
from flexbt_core.behavior_tree.engine.node import NodeConfig
from flexbt_core.behavior_tree.model.errors import PortError
from flexbt_core.behavior_tree.model.ports import STRING, Port, input_port
from flexbt_core.behavior_tree.model.status import NodeStatus

from .leaf_services import RobotFrames, ServerNode
from .topic_cache import SubscribedTopic, TopicCache


class TopicCondition(ServerNode, Condition):
    """Base of conditions on the last message of a topic. A new message ticks the tree.

    ``message_type`` is the class of the messages. The port ``topic_port`` names the topic; default ``default_topic``.
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
        """Return whether the condition holds; ``message`` is None before the first message."""

    @classmethod
    def subscribes_to(cls) -> Sequence[SubscribedTopic]:
        """Its topic, to which the server subscribes when it loads a tree with this node."""
        return [SubscribedTopic(cls.message_type, cls.default_topic, cls.topic_port, cls.qos)]

    @property
    def is_informed(self) -> bool:
        return self._cache is not None and self._cache.latest is not None

    def tick(self) -> NodeStatus:
        if self._cache is None:
            (topic,) = self.subscribes_to()
            self._cache = self.subscribe(topic)
        message = self._cache.latest
        if self.holds(message):
            return NodeStatus.SUCCESS
        if message is None:
            return self.fail(self._cache.without_message('no message yet'))
        return self.fail(self._reason or 'the condition does not hold')


# The common base of leaves for poses, paths and goals. An unknown value is not an error: they fail with the reason.


class PoseLeaf(ServerNode, LeafNode):
    """A leaf that fails while an input is missing on the blackboard, or a transform is unknown.

    List it before the base SyncAction or Condition.
    """

    __slots__ = ('_is_informed',)

    @abstractmethod
    def evaluate(self) -> NodeStatus:
        """Do the work of a tick and return the status. May raise PortError and TransformError."""

    @property
    def is_informed(self) -> bool:
        return self._is_informed

    def tick(self) -> NodeStatus:
        self._is_informed = True
        try:
            return self.evaluate()
        except PortError as error:
            return self.fail(str(error))
        except TransformError as error:
            self._is_informed = False
            return self.fail(f'no pose is known there: {error}')

    @property
    def frames(self) -> RobotFrames:
        """Frames of the robot: its pose, and poses in other frames."""
        return self.host.frames

    def robot_pose(self, frame: str | None = None) -> PoseStamped:
        """Return the pose of the robot for the ports ``robot_base_frame`` and, without ``frame``, ``global_frame``.

        Raises:
            TransformError: the pose is unknown.
        """
        if frame is None:
            frame = str(self.get_input_or('global_frame', ''))
        return self.frames.robot_pose(frame, str(self.get_input_or('robot_base_frame', '')))
