# SPDX-License-Identifier: BSD-3-Clause
"""Shared connections to action servers: one rclpy client for each type and name, kept."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from rclpy.action import ActionClient

from flexbt_common.runtime.names import deep_action_services
from flexbt_common.runtime.node_runtime import NodeRuntime


class _StatusListener(ActionClient):
    """An action client that passes the server's list of goals on, also of goals whose acceptance it does not know.

    The list waits while there is a result: to unpack it takes longer than all the rest.
    """

    on_status: Callable[[bytes, int], None]

    def take_data(self) -> Any:
        if self._is_result_response_ready:
            self._is_status_ready = False
        return super().take_data()

    async def execute(self, taken_data: Any) -> None:
        await super().execute(taken_data)
        for goal in taken_data['status'].status_list if 'status' in taken_data else ():
            self.on_status(bytes(goal.goal_info.goal_id.uuid), goal.status)


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
        self.client: Any = runtime.call(self._make_client)

    def _make_client(self) -> _StatusListener:
        client = _StatusListener(self.runtime.node, self.action_type, self.name, **deep_action_services())
        client.on_status = self._on_status
        return client

    @property
    def type_name(self) -> str:
        """``package/action/Name`` of the action."""
        package, kind, *_ = self.action_type.__module__.split('.')
        return f'{package}/{kind}/{self.action_type.__name__}'

    def is_ready(self) -> bool:
        """Whether an action server of that name and type is there now, as far as discovery knows."""
        return bool(self.client.server_is_ready())

    def _on_status(self, goal_id: bytes, status: int) -> None:
        listener = self.status_listeners.get(goal_id)
        if listener is not None:
            listener(status)

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
                link.client.destroy()
            self._links.clear()

        self._runtime.call(destroy)
