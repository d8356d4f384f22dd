# SPDX-License-Identifier: BSD-3-Clause
"""Shared connections to action servers: one rclpy client for each type and name, kept."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from action_msgs.msg import GoalStatusArray
from rclpy.action import ActionClient
from rclpy.qos import qos_profile_action_status_default

from flexbt_common.names import deep_action_services
from flexbt_common.runtime import ACTION_CLIENT, NodeRuntime, OpenActionClient, is_usable


class ActionServerLink:
    """The connection of this node to one action server. Made by :class:`ActionLinks`.

    ``client`` is rclpy's, to be used on the executor thread only; ``name`` is the server's name as it was asked for.
    ``status_listeners`` are told the status of their goal, by its id, whenever the server publishes its goals.
    """

    def __init__(self, runtime: NodeRuntime, action_type: Any, name: str) -> None:
        self.runtime = runtime
        self.action_type = action_type
        self.name = name
        self.status_listeners: dict[bytes, Callable[[int], None]] = {}
        self._lists: Any = None
        self.client: Any = runtime.call(self._make_client)

    def _make_client(self) -> ActionClient:
        node = self.runtime.node
        arguments, options = (node, self.action_type, self.name), deep_action_services()
        if is_usable(ACTION_CLIENT):
            client = OpenActionClient(*arguments, **options)
            client.on_list = self._on_list
            return client
        topic = f'{self.name}/_action/status'
        self._lists = node.create_subscription(GoalStatusArray, topic, self._on_list, qos_profile_action_status_default)
        return ActionClient(*arguments, **options)

    @property
    def type_name(self) -> str:
        """``package/action/Name`` of the action."""
        package, kind, *_ = self.action_type.__module__.split('.')
        return f'{package}/{kind}/{self.action_type.__name__}'

    def is_ready(self) -> bool:
        """Whether an action server of that name and type is there now, as far as discovery knows."""
        return bool(self.client.server_is_ready())

    def close(self) -> None:
        """Take the client out of the graph."""
        self.client.destroy()
        if self._lists is not None:
            self.runtime.node.destroy_subscription(self._lists)

    def _on_list(self, goals: GoalStatusArray) -> None:
        for goal in goals.status_list:
            listener = self.status_listeners.get(bytes(goal.goal_info.goal_id.uuid))
            if listener is not None:
                listener(goal.status)

    def __str__(self) -> str:
        return f'{self.name!r} ({self.type_name})'


class ActionLinks:
    """The links of one node, so that discovery is paid once for each server. From any thread."""

    def __init__(self, runtime: NodeRuntime) -> None:
        self._runtime = runtime
        self._links: dict[tuple[Any, str], ActionServerLink] = {}
        runtime.on_close(self._close)

    def link(self, action_type: Any, name: str) -> ActionServerLink:
        """The link to the server ``name``; made now if there is none yet."""
        known = self._links.get((action_type, name))
        return known if known is not None else self._runtime.call(lambda: self._link(action_type, name))

    def _link(self, action_type: Any, name: str) -> ActionServerLink:
        key = action_type, name
        if key not in self._links:
            self._links[key] = ActionServerLink(self._runtime, action_type, name)
        return self._links[key]

    def _close(self) -> None:
        def destroy() -> None:
            for link in self._links.values():
                link.close()
            self._links.clear()

        self._runtime.call(destroy)
