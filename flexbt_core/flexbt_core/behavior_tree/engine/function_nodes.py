# SPDX-License-Identifier: BSD-3-Clause
"""Node classes made of one function each, for simple nodes without a separate class::

    registry.register('CloseGripper', simple_action(lambda node: gripper.close()))
    registry.register('BatteryOk', simple_condition(battery_ok, ports={'minimum': input_port(DOUBLE)}))

    def battery_ok(node: TreeNode) -> bool:
        return battery.level >= node.get_input('minimum')

The function takes the node, so that it can use ports, clock and services. The class gets the name and the docstring of
the function.
"""

from __future__ import annotations

import types
from abc import abstractmethod
from collections.abc import Callable, Mapping
from typing import Any

from flexbt_core.behavior_tree.model.ports import Port
from flexbt_core.behavior_tree.model.status import FAILURE, IDLE, RUNNING, SUCCESS, NodeStatus

from .leaf import Condition, SyncAction
from .node import NO_PORTS
from .parents import Decorator

ActionFunction = Callable[['SimpleAction'], NodeStatus]
ConditionFunction = Callable[[Condition], 'NodeStatus | bool']
DecoratorFunction = Callable[[NodeStatus, 'SimpleDecorator'], NodeStatus]


class SimpleAction(SyncAction):
    """An action made of a function, :meth:`call`. It stores its status as BehaviorTree.CPP's SimpleActionNode does.

    An observer sees it RUNNING during the call. It is the only node that stores SKIPPED. It stores its result before
    the scripts of its post-conditions run.
    """

    __slots__ = ()

    running_at_completion = None

    @abstractmethod
    def call(self) -> NodeStatus:
        """Do the work."""

    def tick(self) -> NodeStatus:
        if self.stored_status is IDLE:
            self.status = RUNNING
        status = self.checked(self.call())
        self.store_status(status)
        return status


class SimpleDecorator(Decorator):
    """A decorator made of a function from the status of the child to the status of the node.

    If the function completes the node while the child is RUNNING, the child is halted.
    """

    __slots__ = ()

    @abstractmethod
    def decorate(self, status: NodeStatus) -> NodeStatus:
        """Return the status of the node for this ``status`` of the child."""

    def tick(self) -> NodeStatus:
        status = self.decorate(self.tick_child())
        if (status is SUCCESS or status is FAILURE) and self.child.stored_status is RUNNING:
            self.halt_child()
        return status


def simple_action(function: ActionFunction, ports: Mapping[str, Port] = NO_PORTS) -> type[SimpleAction]:
    """Return an action that calls ``function``, which returns SUCCESS, FAILURE or SKIPPED."""

    def call(self: SimpleAction) -> NodeStatus:
        return function(self)

    return _node_class(SimpleAction, function, ports, call=call)


def simple_condition(function: ConditionFunction, ports: Mapping[str, Port] = NO_PORTS) -> type[Condition]:
    """Return a condition that holds if ``function`` returns SUCCESS or True."""

    def tick(self: Condition) -> NodeStatus:
        result = function(self)
        if result is True:
            return SUCCESS
        return FAILURE if result is False else result

    return _node_class(Condition, function, ports, tick=tick)


def simple_decorator(function: DecoratorFunction, ports: Mapping[str, Port] = NO_PORTS) -> type[SimpleDecorator]:
    """Return a decorator whose result is ``function(status of the child, node)``."""

    def decorate(self: SimpleDecorator, status: NodeStatus) -> NodeStatus:
        return function(status, self)

    return _node_class(SimpleDecorator, function, ports, decorate=decorate)


def _node_class(
    base: type[Any], function: Callable[..., object], ports: Mapping[str, Port], **method: Callable[..., NodeStatus]
) -> type[Any]:
    def fill(namespace: dict[str, Any]) -> None:
        namespace.update(
            method,
            __slots__=(),
            __module__=getattr(function, '__module__', __name__),
            __doc__=function.__doc__,
            ports=dict(ports),
        )

    name: str = getattr(function, '__name__', type(function).__name__)
    return types.new_class(name, (base,), exec_body=fill)
