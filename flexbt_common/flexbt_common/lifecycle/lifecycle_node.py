# SPDX-License-Identifier: BSD-3-Clause
"""rclpy's node with a lifecycle, whose services can be answered in another way, and which leaves nothing behind."""

from __future__ import annotations

from typing import Any

from lifecycle_msgs.srv import ChangeState, GetState
from rclpy.lifecycle import LifecycleNode, LifecycleNodeMixin
from rclpy.node import Node

from flexbt_common.runtime import DeepNode, release_lifecycle


class OpenLifecycleNode(DeepNode, LifecycleNode):
    """``self._get_state`` and ``self._change_state`` are rclpy's answers; :meth:`answer_get_state` and
    :meth:`answer_change_state` are what is answered. For a transition that is not possible rclpy raises RCLError."""

    def __init__(self, name: str, **options: Any) -> None:
        Node.__init__(self, name, **options)
        LifecycleNodeMixin.__init__(self)
        served = {service.srv_type: service for service in self.services}
        self._get_state = served[GetState].callback
        self._change_state = served[ChangeState].callback
        served[GetState].callback = self.answer_get_state
        served[ChangeState].callback = self.answer_change_state

    @property
    def state(self) -> str:
        """The state, or the transition that goes on, by its standard name: 'unconfigured', 'configuring' ..."""
        return str(self._get_state(GetState.Request(), GetState.Response()).current_state.label)

    def answer_get_state(self, request: Any, response: Any) -> Any:
        """The state, as rclpy knows it."""
        return self._get_state(request, response)

    def answer_change_state(self, request: Any, response: Any) -> Any:
        """Whether the transition was made; a coroutine, if it takes its time."""
        raise NotImplementedError

    def destroy_node(self) -> None:
        """As that of the base, which leaves the services of the lifecycle in the graph until Python collects them."""
        super().destroy_node()
        release_lifecycle(self)
