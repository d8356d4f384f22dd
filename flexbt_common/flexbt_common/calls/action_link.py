# SPDX-License-Identifier: BSD-3-Clause
"""The connections of a node to action servers."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from typing import Any

from action_msgs.msg import GoalStatusArray
from rclpy.action import ActionClient
from rclpy.qos import qos_profile_action_status_default

from flexbt_common.names import deep_action_services
from flexbt_common.runtime import ACTION_CLIENT, NodeRuntime, OpenActionClient, is_usable

from .links import Links, ServerLink, ServerNodes


class ActionServerLink(ServerLink):
    """The connection of this node to one action server. Made by :class:`ActionLinks`, on the executor thread.

    ``client`` is rclpy's, to be used on the executor thread only; ``name`` is the server's name as it was asked for.
    ``status_listeners`` are told the status of their goal, by its id, whenever the server publishes its goals.
    """

    def __init__(self, runtime: NodeRuntime, action_type: Any, name: str, nodes: ServerNodes) -> None:
        super().__init__(runtime, name, nodes, f'rt{runtime.node.resolve_topic_name(f"{name}/_action/status")}')
        self.action_type = action_type
        self.status_listeners: dict[bytes, Callable[[int], None]] = {}
        self.client: Any = self._make_client()

    def _make_client(self) -> ActionClient:
        node = self.runtime.node
        arguments, options = (node, self.action_type, self.name), deep_action_services()
        tell = partial(_tell, self.status_listeners)
        if is_usable(ACTION_CLIENT):
            client = OpenActionClient(*arguments, **options)
            client.on_list = tell  # which does not hold the link
            return client
        topic = f'{self.name}/_action/status'
        listening = node.create_subscription(GoalStatusArray, topic, tell, qos_profile_action_status_default)
        self.subscriptions = (listening,)
        return ActionClient(*arguments, **options)

    @property
    def type_name(self) -> str:
        """``package/action/Name`` of the action."""
        package, kind, *_ = self.action_type.__module__.split('.')
        return f'{package}/{kind}/{self.action_type.__name__}'

    def is_shown(self) -> bool:
        """See :meth:`ServerLink.is_shown`."""
        return bool(self.client.server_is_ready())

    def __str__(self) -> str:
        return f'{self.name!r} ({self.type_name})'


def _tell(listeners: Mapping[bytes, Callable[[int], None]], goals: GoalStatusArray) -> None:
    for goal in goals.status_list:
        listener = listeners.get(bytes(goal.goal_info.goal_id.uuid))
        if listener is not None:
            listener(goal.status)


class ActionLinks(Links[ActionServerLink]):
    """The links of one node to action servers."""

    link_class = ActionServerLink
