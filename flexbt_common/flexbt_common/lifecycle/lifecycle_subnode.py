# SPDX-License-Identifier: BSD-3-Clause
"""A part of a process that appears as a managed node with its own name.

Lifecycle managers, ``ros2 lifecycle``, ``ros2 param`` and Nav2's ``BasicNavigator`` look for the node ``amcl`` and its
services, but the process that localizes the robot may have another name. Such a part is a managed node in that process.
It starts active, and is notified when it becomes active or inactive.

A separate thread serves the requests to all parts of a process, and sleeps until one arrives. The executor of the
process wakes dozens of times a second, and would check for requests to each part every time.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Sequence
from typing import Any, Final

from lifecycle_msgs.msg import State
from rcl_interfaces.msg import ParameterDescriptor, SetParametersResult
from rclpy.action.server import RCLError
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node
from rclpy.parameter import Parameter

from flexbt_common import names
from flexbt_common.runtime.node_executor import make_executor
from flexbt_common.runtime.node_runtime import Runtime

from .managed_node import ExtendedLifecycleNode

_USE_SIM_TIME: Final = 'use_sim_time'


class LifecycleSubnode:
    """The managed node ``name`` of a process. Create and close it on the executor thread; it ends with ``runtime``.

    ``on_change`` is called with :attr:`is_active` after each transition that changes it. While the node is active and
    ``is_ready`` returns False, it reports the state "activating". The name is relative to the namespace of the node of
    ``runtime``. That node has the log, and the parameters read at the start of the process. A node that
    ``has_parameters`` may :meth:`declare` others; their six services cost an idle node some processor time.
    """

    def __init__(
        self,
        runtime: Runtime,
        name: str,
        on_change: Callable[[bool], object] = lambda _is_active: None,
        is_ready: Callable[[], bool] = lambda: True,
        has_parameters: bool = False,
    ) -> None:
        host = runtime.node
        namespace, _, own_name = names.of_robot(host.get_namespace(), name).rpartition('/')
        self._runtime = runtime
        self._on_set: dict[str, Callable[[Any], object]] = {}
        self._is_closed = False
        self._node = _Subnode(
            own_name,
            lambda is_active: self._call_while_open(lambda: on_change(is_active)),
            is_ready,
            namespace=namespace,
            context=host.context,
            use_global_arguments=False,
            enable_rosout=False,
            start_parameter_services=has_parameters,
            parameter_overrides=[
                Parameter('start_type_description_service', value=False),
                Parameter(_USE_SIM_TIME, value=self._has_simulated_time),
            ],
        )
        host.add_post_set_parameters_callback(self._follow_clock)
        self._node.add_on_set_parameters_callback(self._refuse_clock)
        self._node.add_post_set_parameters_callback(self._tell_set)
        self._thread = runtime.once(LifecycleSubnode, _SubnodesThread)
        self._thread.add(self._node)
        runtime.nodes.append(self._node)

    @property
    def is_active(self) -> bool:
        """True if the node is active. From any thread."""
        return self._node.is_active

    def declare(self, name: str, value: Any, descriptor: ParameterDescriptor, on_set: Callable[[Any], object]) -> None:
        """Declare a parameter that can be set at any time; ``on_set`` is called with each new value."""
        self._node.declare_parameter(name, value, descriptor)
        self._on_set[name] = on_set

    def close(self) -> None:
        """Remove the node from the graph. What requests have changed and nobody was told is not told any more."""
        self._is_closed = True
        self._runtime.node.remove_post_set_parameters_callback(self._follow_clock)
        self._thread.remove(self._node)
        self._runtime.nodes.remove(self._node)
        self._node.destroy_node()

    def _refuse_clock(self, parameters: Sequence[Parameter]) -> SetParametersResult:
        own = self._has_simulated_time
        if all(parameter.name != _USE_SIM_TIME or parameter.value == own for parameter in parameters):
            return SetParametersResult(successful=True)
        host = self._runtime.node.get_fully_qualified_name()
        reason = f'{self._node.get_name()} has the time of its process: set {_USE_SIM_TIME} of {host}'
        return SetParametersResult(successful=False, reason=reason)

    @property
    def _has_simulated_time(self) -> bool:
        return bool(self._runtime.node.get_parameter(_USE_SIM_TIME).value)

    def _follow_clock(self, parameters: Sequence[Parameter]) -> None:
        if any(parameter.name == _USE_SIM_TIME for parameter in parameters):
            self._node.set_parameters([Parameter(_USE_SIM_TIME, value=self._has_simulated_time)])

    def _tell_set(self, parameters: Sequence[Parameter]) -> None:
        def tell() -> None:
            for parameter in parameters:
                if parameter.name in self._on_set:
                    self._on_set[parameter.name](parameter.value)

        self._call_while_open(tell)

    def _call_while_open(self, fn: Callable[[], object]) -> None:
        self._runtime.call(lambda: None if self._is_closed else fn())


class _SubnodesThread:
    """A thread that serves the parts of a process. Create it and add parts on the executor thread."""

    def __init__(self, runtime: Runtime) -> None:
        self._runtime = runtime
        self._is_closed = False
        self._thread: threading.Thread | None = None
        runtime.on_close(self._close)

    def add(self, node: Node) -> None:
        """Start answering requests to a node."""
        if self._thread is None:
            self._executor = make_executor(node, self._report, lambda: None, self._later)
            thread = threading.Thread(target=self._spin, name=f'{self._runtime.name}_parts', daemon=True)
            thread.start()
            self._thread = thread
        else:
            self._executor.add_node(node)

    def remove(self, node: Node) -> None:
        """Stop answering requests to a node."""
        self._executor.remove_node(node)

    def _report(self, error: Exception) -> None:
        self._runtime.post(lambda: self._runtime.report_fault(error, 'a service of a managed node'))

    def _later(self, seconds: float, fn: Callable[[], object]) -> None:
        steady = self._runtime.steady
        steady.call_at(steady.now() + seconds, lambda: self._executor.create_task(fn))

    def _spin(self) -> None:
        while not self._is_closed:
            try:
                self._executor.turn(None)
            except ExternalShutdownException:
                return
            except Exception as error:
                self._report(error)

    def _close(self) -> None:
        self._is_closed = True
        if self._thread is not None:
            self._executor.wake()
            self._thread.join()
            self._executor.shutdown()


class _Subnode(ExtendedLifecycleNode):
    def __init__(
        self, name: str, on_change: Callable[[bool], object], is_ready: Callable[[], bool], **options: Any
    ) -> None:
        super().__init__(name, **options)
        self._on_change = on_change
        self._is_ready = is_ready
        self.trigger_configure()
        self.trigger_activate()
        self.is_active = True

    def create_subscription(self, msg_type: Any, topic: str, *args: Any, **options: Any) -> Any:
        """See :meth:`LargeQueueNode.create_subscription`. Ignores rclpy's request for /clock: nothing reads the time
        of a part, and its thread would wake for each message."""
        return None if topic == names.CLOCK else super().create_subscription(msg_type, topic, *args, **options)

    def answer_get_state(self, request: Any, response: Any) -> Any:
        """Return the state, as :class:`LifecycleSubnode` describes."""
        if self.is_active and not self._is_ready():
            response.current_state = State(id=State.TRANSITION_STATE_ACTIVATING, label='activating')
            return response
        return super().answer_get_state(request, response)

    def answer_change_state(self, request: Any, response: Any) -> Any:
        """Make a transition, as :class:`LifecycleSubnode` describes."""
        try:
            response = self._change_state(request, response)
        except RCLError:  # no valid transition; rclpy would not answer
            response.success = False
        is_active = self.state == 'active'
        if is_active != self.is_active:
            self.is_active = is_active
            self._on_change(is_active)
        return response
