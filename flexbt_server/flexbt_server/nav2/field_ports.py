# SPDX-License-Identifier: BSD-3-Clause
"""Leaves of Nav2 whose input ports fill the fields of a message, and whose output ports get those of the answer."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, ClassVar, Final

from builtin_interfaces.msg import Duration
from geometry_msgs.msg import Point

from flexbt_common.calls.action_call import GoalOutcome
from flexbt_common.values.message_fields import duration_message, seconds_of, set_poses
from flexbt_common.values.value_types import message_type_name
from flexbt_core.behavior_tree.engine.leaf import LeafNode
from flexbt_core.behavior_tree.model.ports import DOUBLE, FLOAT, NO_DEFAULT
from flexbt_core.behavior_tree.model.status import NodeStatus
from flexbt_server.leaves.action_leaf import ACTION_PORTS, ActionLeaf
from flexbt_server.leaves.leaf_services import ServerNode
from flexbt_server.leaves.service_leaf import SERVICE_PORTS, ServiceNode

_OF_ALL: Final = frozenset((*ACTION_PORTS, *SERVICE_PORTS))


class FieldPorts(ServerNode, LeafNode):
    """A leaf whose ports are named like fields, except those in ``renamed``, where '' means that a port has no field.

    Fields that the installed interfaces lack are left out, since Nav2's branches differ.
    """

    __slots__ = ()

    renamed: ClassVar[Mapping[str, str]] = {}

    def filled(self, message: Any, *ports: str) -> Any:
        """Return the message with the values of these input ports, by default all that the leaf itself declares.

        A number that the blackboard lacks is an error; other missing optional values leave their fields unset.
        If a tree sets a port without a field to a value other than its default, the node logs that once.
        """
        for port in ports or [name for name in self.ports if name not in _OF_ALL and self.ports[name].readable]:
            field = self.renamed.get(port, port)
            if field and self._has_field(message, field, port):
                declared = self.ports[port]
                is_number = declared.type in (DOUBLE, FLOAT) and declared.default is not NO_DEFAULT
                needed = declared.required or is_number
                value = self.get_input(port) if needed else self.get_input_or(port, None)
                if value is not None:
                    _set_field(message, field, value)
        return message

    def write(self, message: Any) -> None:
        """Write the output ports whose fields the message has."""
        for port, declared in self.ports.items():
            field = self.renamed.get(port, port)
            if port not in _OF_ALL and declared.writable and hasattr(message, field):
                value = getattr(message, field)
                is_time = declared.type is DOUBLE and isinstance(value, Duration)
                self.set_output(port, seconds_of(value) if is_time else value)

    def _has_field(self, message: Any, field: str, port: str) -> bool:
        if hasattr(message, field):
            return True
        given = self.port_text(port)
        if given is not None and given != self.ports[port].default:
            self.host.warn_once(
                f'{self.id}: the port [{port}] has no effect: {message_type_name(type(message))}, as it is installed, '
                f'has no field of this name'
            )
        return False


def _set_field(message: Any, field: str, value: Any) -> None:
    """Set a field. A number is the seconds of a Duration, and the x of a Point."""
    there = getattr(message, field)
    if isinstance(value, list):
        set_poses(message, field, value)
        return
    if isinstance(value, float) and isinstance(there, Duration):
        value = duration_message(value)
    elif isinstance(value, float) and isinstance(there, Point):
        value = Point(x=value)
    setattr(message, field, value)


class FieldAction(FieldPorts, ActionLeaf):
    """A leaf whose input ports are the goal and whose output ports are the result, which is empty if none was sent."""

    __slots__ = ()

    def make_goal(self) -> Any:
        return self.filled(self.action_type.Goal())

    def on_success(self, result: Any) -> NodeStatus:
        self.write(result)
        return NodeStatus.SUCCESS

    def on_failure(self, outcome: GoalOutcome) -> NodeStatus | None:
        self.write(self.action_type.Result() if outcome.result is None else outcome.result)
        if 'success' in self.ports:
            self.set_output('success', False)  # whatever the default of the field is
        return None


class FieldService(FieldPorts, ServiceNode):
    """A leaf whose input ports are the request."""

    __slots__ = ()

    def make_request(self) -> Any:
        return self.filled(self.service_type.Request())
