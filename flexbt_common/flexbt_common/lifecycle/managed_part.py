# SPDX-License-Identifier: BSD-3-Clause
"""A part of a process that is known as a managed node of a name of its own.

Lifecycle managers, ``ros2 lifecycle`` and Nav2's ``BasicNavigator`` look for the node ``amcl`` and its services; the
process that tells where the robot is may be called otherwise. Such a part is a node with a lifecycle in that process,
on the same executor, and is told when it is to work. It begins as active.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from lifecycle_msgs.msg import State
from rclpy.action.server import RCLError
from rclpy.parameter import Parameter

from flexbt_common import names
from flexbt_common.runtime import NodeRuntime

from .lifecycle_node import OpenLifecycleNode


class ManagedPart:
    """The managed node ``name`` of a process. Made and closed on the executor thread; it ends with ``runtime``.

    ``on_change`` is called with :attr:`is_active` after each transition that changes it. While it is active and
    ``is_ready`` gives False, those who ask are told that it is activating. The name is relative to the namespace of the
    node of ``runtime``, which has the parameters and the log.
    """

    def __init__(
        self,
        runtime: NodeRuntime,
        name: str,
        on_change: Callable[[bool], object] = lambda _is_active: None,
        is_ready: Callable[[], bool] = lambda: True,
    ) -> None:
        host = runtime.node
        namespace, _, own_name = names.of_robot(host.get_namespace(), name).rpartition('/')
        self._node = _PartNode(
            own_name,
            on_change,
            is_ready,
            namespace=namespace,
            context=host.context,
            use_global_arguments=False,
            enable_rosout=False,
            start_parameter_services=False,
            parameter_overrides=[Parameter('start_type_description_service', value=False)],
        )
        self._executor = host.executor
        self._executor.add_node(self._node)

    @property
    def is_active(self) -> bool:
        """Whether it is to work; on any thread."""
        return self._node.is_active

    def close(self) -> None:
        """Take the node out of the graph."""
        self._executor.remove_node(self._node)
        self._node.destroy_node()


class _PartNode(OpenLifecycleNode):
    def __init__(
        self, name: str, on_change: Callable[[bool], object], is_ready: Callable[[], bool], **options: Any
    ) -> None:
        super().__init__(name, **options)
        self._on_change = on_change
        self._is_ready = is_ready
        self.trigger_configure()
        self.trigger_activate()
        self.is_active = True

    def answer_get_state(self, request: Any, response: Any) -> Any:
        """As ManagedPart says."""
        if self.is_active and not self._is_ready():
            response.current_state = State(id=State.TRANSITION_STATE_ACTIVATING, label='activating')
            return response
        return super().answer_get_state(request, response)

    def answer_change_state(self, request: Any, response: Any) -> Any:
        """As ManagedPart says."""
        try:
            response = self._change_state(request, response)
        except RCLError:  # no such transition now; rclpy would not answer at all
            response.success = False
        is_active = self.state == 'active'
        if is_active != self.is_active:
            self.is_active = is_active
            self._on_change(is_active)
        return response
