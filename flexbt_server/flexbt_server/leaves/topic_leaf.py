# SPDX-License-Identifier: BSD-3-Clause
"""Leaves that read a topic."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping
from typing import Any, ClassVar, Final

from rclpy.qos import QoSProfile
from std_msgs.msg import String

from flexbt_common import names
from flexbt_core.behavior_tree import Condition, NodeConfig, NodeStatus, Port, SyncAction, input_port, output_port
from flexbt_core.behavior_tree.model import STRING

from .leaf_services import LeafServices
from .topic_cache import TopicCache


class TopicCondition(Condition):
    """Base of conditions on the last message of a topic. A new message ticks the tree.

    ``message_type`` is the class of the messages; the topic is the port ``topic_name``, or ``default_topic``.
    """

    __slots__ = ('_cache',)

    message_type: ClassVar[type[Any]]
    default_topic: ClassVar[str] = ''
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

    def tick(self) -> NodeStatus:
        if self._cache is None:
            services: LeafServices = self.services
            topic = str(self.get_input_or('topic_name', '') or self.default_topic)
            self._cache = services.topics.cache(self.message_type, topic, self.qos)
            self._cache.on_message(self.context)
        message = self._cache.latest
        if self.holds(message):
            return NodeStatus.SUCCESS
        return self.fail('no message yet' if message is None else 'the condition does not hold')


class _Selector(SyncAction):
    """Writes the name that was last published on a latched topic, or the default."""

    __slots__ = ('_cache',)

    selected: ClassVar[str]
    default: ClassVar[str]

    def __init__(self, config: NodeConfig) -> None:
        super().__init__(config)
        self._cache: TopicCache | None = None

    def tick(self) -> NodeStatus:
        if self._cache is None:
            services: LeafServices = self.services
            self._cache = services.topics.cache(String, str(self.get_input('topic_name')), names.latched())
            self._cache.on_message(self.context)
        message = self._cache.latest
        name = message.data if message is not None else str(self.get_input_or(self.default, ''))
        if not name:
            return self.fail(
                f'nothing was published on {self.get_input("topic_name")}, and {self.default} is not given'
            )
        self.set_output(self.selected, name)
        return NodeStatus.SUCCESS


def _selector_ports(kind: str) -> Mapping[str, Port]:
    what = kind.replace('_', ' ')
    return {
        'topic_name': input_port(STRING, default=f'{kind}_selector', description='latched topic, std_msgs/String'),
        f'default_{kind}': input_port(STRING, optional=True, description=f'{what} while nothing was published'),
        f'selected_{kind}': output_port(STRING, description=f'name of the {what}'),
    }


class ControllerSelector(_Selector):
    """Selects the controller for FollowPath."""

    __slots__ = ()
    selected, default = 'selected_controller', 'default_controller'
    ports = _selector_ports('controller')


class PlannerSelector(_Selector):
    """Selects the planner for ComputePath nodes."""

    __slots__ = ()
    selected, default = 'selected_planner', 'default_planner'
    ports = _selector_ports('planner')


class SmootherSelector(_Selector):
    """Selects the smoother."""

    __slots__ = ()
    selected, default = 'selected_smoother', 'default_smoother'
    ports = _selector_ports('smoother')


class GoalCheckerSelector(_Selector):
    """Selects the goal checker for FollowPath."""

    __slots__ = ()
    selected, default = 'selected_goal_checker', 'default_goal_checker'
    ports = _selector_ports('goal_checker')


class ProgressCheckerSelector(_Selector):
    """Selects the progress checker for FollowPath."""

    __slots__ = ()
    selected, default = 'selected_progress_checker', 'default_progress_checker'
    ports = _selector_ports('progress_checker')


NODES: Final = (
    ControllerSelector,
    PlannerSelector,
    SmootherSelector,
    GoalCheckerSelector,
    ProgressCheckerSelector,
)
