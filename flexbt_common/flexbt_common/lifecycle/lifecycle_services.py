# SPDX-License-Identifier: BSD-3-Clause
"""The lifecycle of a part of a node that stands in for a managed node of another name.

A lifecycle manager, or Nav2's ``BasicNavigator``, asks for ``amcl/get_state``; the process that tells where the robot
is may be called otherwise. Such a part needs no node of its own: it has the two services under that name, and is told
when it is to work. It begins as active.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Final

from lifecycle_msgs.msg import State, Transition
from lifecycle_msgs.srv import ChangeState, GetState
from rclpy.node import Node

LABELS: Final = {
    State.PRIMARY_STATE_UNCONFIGURED: 'unconfigured',
    State.PRIMARY_STATE_INACTIVE: 'inactive',
    State.PRIMARY_STATE_ACTIVE: 'active',
    State.PRIMARY_STATE_FINALIZED: 'finalized',
}

_UNCONFIGURED, _INACTIVE, _ACTIVE, _FINALIZED = LABELS

TRANSITIONS: Final = {
    (_UNCONFIGURED, Transition.TRANSITION_CONFIGURE): ('configure', _INACTIVE),
    (_INACTIVE, Transition.TRANSITION_CLEANUP): ('cleanup', _UNCONFIGURED),
    (_INACTIVE, Transition.TRANSITION_ACTIVATE): ('activate', _ACTIVE),
    (_ACTIVE, Transition.TRANSITION_DEACTIVATE): ('deactivate', _INACTIVE),
    (_UNCONFIGURED, Transition.TRANSITION_UNCONFIGURED_SHUTDOWN): ('shutdown', _FINALIZED),
    (_INACTIVE, Transition.TRANSITION_INACTIVE_SHUTDOWN): ('shutdown', _FINALIZED),
    (_ACTIVE, Transition.TRANSITION_ACTIVE_SHUTDOWN): ('shutdown', _FINALIZED),
}
"""Label and end of each transition by state and number (https://design.ros2.org/articles/node_lifecycle.html)."""


class LifecycleServices:
    """Services ``NAME/get_state`` and ``NAME/change_state``. On the executor thread.

    ``on_change`` is called with :attr:`is_active` after each transition that changes it. While it is active and
    ``is_ready`` gives False, those who ask are told that it is activating. A name that is not absolute is relative to
    the node's namespace.
    """

    def __init__(
        self,
        node: Node,
        name: str,
        on_change: Callable[[bool], object] = lambda _is_active: None,
        is_ready: Callable[[], bool] = lambda: True,
    ) -> None:
        self._node = node
        self._on_change = on_change
        self._is_ready = is_ready
        self._state: int = _ACTIVE
        self._services = (
            node.create_service(GetState, f'{name}/get_state', self._tell),
            node.create_service(ChangeState, f'{name}/change_state', self._change),
        )

    @property
    def is_active(self) -> bool:
        """Whether it is to work."""
        return self._state == _ACTIVE

    @property
    def label(self) -> str:
        """The state by its standard name."""
        return LABELS[self._state]

    def close(self) -> None:
        """Take the services back."""
        for service in self._services:
            self._node.destroy_service(service)

    def _tell(self, request: Any, response: Any) -> Any:
        if self.is_active and not self._is_ready():
            response.current_state = State(id=State.TRANSITION_STATE_ACTIVATING, label='activating')
        else:
            response.current_state = State(id=self._state, label=self.label)
        return response

    def _change(self, request: Any, response: Any) -> Any:
        wanted, was_active = request.transition, self.is_active
        for (state, number), (label, end) in TRANSITIONS.items():
            # As with rcl: the label counts when there is one.
            if state == self._state and (wanted.label == label if wanted.label else wanted.id == number):
                self._state = end
                response.success = True
                if self.is_active != was_active:
                    self._on_change(self.is_active)
                return response
        response.success = False
        return response
