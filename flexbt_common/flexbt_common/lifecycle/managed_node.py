# SPDX-License-Identifier: BSD-3-Clause
"""A managed node, as lifecycle managers and launch files know it (https://design.ros2.org/articles/node_lifecycle.html).

rclpy's ``LifecycleNode`` makes a whole transition within one callback. Ours have to wait: what runs comes to rest with
the help of the executor. So transitions have a thread of their own, where they are made one after the other, and the
answer of ``change_state`` is sent when the transition is over. Meanwhile the node answers everybody else.

What exists in which state:

============  =========================================================================================================
unconfigured  parameters, which can be set; the services of the lifecycle; what ``waiting`` makes
inactive      what ``configure`` makes; it refuses to work
active        it works
finalized     the services of the lifecycle, until the process ends
============  =========================================================================================================

It is alive for others in every state (:mod:`flexbt_common.liveness.liveliness`), and ready when it is active.

An error in a transition is logged, and the node is unconfigured afterwards: it can be configured again.
"""

from __future__ import annotations

import contextlib
import threading
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import Any, Final, Protocol

from diagnostic_msgs.msg import DiagnosticStatus
from rcl_interfaces.msg import ParameterDescriptor
from rclpy.action.server import RCLError
from rclpy.lifecycle import LifecycleState, TransitionCallbackReturn
from rclpy.node import Node
from rclpy.task import Future

from flexbt_common.liveness import LivelinessToken
from flexbt_common.runtime import NodeRuntime, refuse_while_configured, run_node
from flexbt_core.errors import FlexbtError
from flexbt_core.values import one_line

from .diagnostics import DiagnosticsPublisher, diagnostic_status
from .lifecycle_node import OpenLifecycleNode
from .node_scope import NodeScope

DEACTIVATED: Final = 'was deactivated'
SHUTTING_DOWN: Final = 'is shutting down'
"""Why something was stopped; they follow a subject."""

STOP_SECONDS: Final = 10.0
"""How long a node that is deactivated waits for what runs to come to rest."""

_AUTOSTART: Final = ParameterDescriptor(
    description='whether the node configures and activates itself; if not, a lifecycle manager has to',
    read_only=True,
)


class Managed(Protocol):
    """What a node is while it is configured. Called off the executor thread."""

    def activate(self) -> None:
        """Begin to work."""

    def deactivate(self, why: str, refusal: str, within: float) -> None:
        """Refuse what comes from now on, and stop what runs; come back when it is at rest and all results are sent.

        ``why`` tells what is stopped, ``refusal`` what is refused; they follow a subject, as in 'the server was
        deactivated'. ``within`` is in seconds of wall time.

        Raises:
            FlexbtError: something did not halt in this time.
        """


Maker = Callable[[NodeRuntime, str], Managed]
"""Gets a runtime that ends with the configured node, and why the node refuses to work until it is activated: ''
when it is going to be activated at once, so that nobody who meets it meanwhile is refused."""

Waiting = Callable[[NodeRuntime], object]
Declare = Callable[[Node], object]


def inactive(node: Node) -> str:
    """Why a node that is inactive refuses to work; follows a subject."""
    return f'is inactive; activate it (ros2 lifecycle set {node.get_fully_qualified_name()} activate)'


def unconfigured(node: Node) -> str:
    """Why a node that is not configured refuses to work; follows a subject."""
    error = node.error if isinstance(node, ManagedNode) else None
    why = '' if error is None else f' because of an error: {one_line(str(error) or type(error).__name__, 1000)}'
    name = node.get_fully_qualified_name()
    return f'is unconfigured{why}; configure and activate it (ros2 lifecycle set {name} configure)'


class ManagedNode(OpenLifecycleNode):
    """The node of a :class:`NodeRuntime`; :meth:`manage` says of what."""

    def __init__(self, name: str, **options: Any) -> None:
        super().__init__(name, **options)
        self._is_managed = threading.Event()
        self._transitions = ThreadPoolExecutor(1, f'{name}_transitions', initializer=self._is_managed.wait)
        self._error: Exception | None = None

    def manage(
        self,
        runtime: NodeRuntime,
        configure: Maker,
        waiting: Waiting = lambda _: None,
        parameters: Declare = lambda _: None,
    ) -> None:
        """Begin, and configure and activate the node when the parameter ``autostart`` says so.

        ``configure`` makes what the node consists of, ``waiting`` what it shows while it is unconfigured, on a runtime
        that ends with this state. Both are called off the executor thread. ``parameters`` declares those that can be
        set before the node is configured for the first time; ``configure`` does it, too.

        Raises:
            FlexbtError: what ``configure`` or ``activate`` raise when it starts by itself.
        """
        self._runtime = runtime
        self._configure = configure
        self._waiting = waiting
        self._token = LivelinessToken(runtime)  # it is alive in every state, and ready when it is active
        self._is_starting = is_automatic = runtime.call(self._declare)
        self._scope = NodeScope(runtime)
        runtime.on_close(self._end)
        if not is_automatic:
            try:
                runtime.call(lambda: parameters(self))
            except FlexbtError as error:
                self._error = error
                runtime.are_parameters_declared = False
            waiting(self._scope)
            if self._error is None:
                self.get_logger().info('unconfigured; waits for a lifecycle manager (autostart is off)')
            else:
                self.get_logger().warning(f'cannot be configured so: {self._error}')
        self._is_managed.set()
        if not is_automatic:
            return
        self._transitions.submit(self._start).result()
        if self._error is not None:
            raise self._error

    @property
    def error(self) -> Exception | None:
        """Error of the last transition, or of the parameters; None if there was none."""
        return self._error

    def on_configure(self, state: LifecycleState) -> TransitionCallbackReturn:
        """For rclpy."""
        refusal = '' if self._is_starting else inactive(self)
        return self._step(lambda: self._enter(lambda runtime: self._configure(runtime, refusal)))

    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """For rclpy."""
        return self._step(self._activate)

    def on_deactivate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """For rclpy."""
        return self._step(self._deactivate)

    def on_cleanup(self, state: LifecycleState) -> TransitionCallbackReturn:
        """For rclpy."""
        return self._step(lambda: self._enter(self._waiting))

    def on_shutdown(self, state: LifecycleState) -> TransitionCallbackReturn:
        """For rclpy."""
        return self._step(self._shut_down)

    def on_error(self, state: LifecycleState) -> TransitionCallbackReturn:
        """For rclpy."""
        if self._is_starting:  # the process ends: nobody is to configure it
            return TransitionCallbackReturn.SUCCESS
        try:
            self._enter(self._waiting)
        except Exception as error:
            self._runtime.report_fault(error, 'the way back from an error')
            return TransitionCallbackReturn.FAILURE
        return TransitionCallbackReturn.SUCCESS

    def _start(self) -> None:
        self.trigger_configure()
        if self._error is None:
            self.trigger_activate()
        self._is_starting = False

    def _activate(self) -> None:
        self._managed.activate()
        self._token.set_ready(True)

    def _deactivate(self) -> None:
        self._token.set_ready(False)
        self._managed.deactivate(DEACTIVATED, inactive(self), STOP_SECONDS)

    def _shut_down(self) -> None:
        self._token.set_ready(False)
        self._scope.close()

    def _enter(self, make: Callable[[NodeRuntime], Any]) -> None:
        self._scope.close()
        self._scope = NodeScope(self._runtime)
        self._managed = make(self._scope)

    def _step(self, step: Callable[[], None]) -> TransitionCallbackReturn:
        self._error = None
        try:
            step()
        except Exception as error:
            self._error = error
            return TransitionCallbackReturn.ERROR
        return TransitionCallbackReturn.SUCCESS

    def _declare(self) -> bool:
        DiagnosticsPublisher(self._runtime, lambda: [self._diagnosis()])
        self.add_on_set_parameters_callback(lambda parameters: refuse_while_configured(self, parameters, self.state))
        return bool(self.declare_parameter('autostart', True, _AUTOSTART).value)

    def _diagnosis(self) -> DiagnosticStatus:
        state, error = self.state, self._error
        if error is not None:
            return diagnostic_status(
                self._runtime, 'lifecycle', DiagnosticStatus.ERROR, f'{state}: {error or type(error).__name__}'
            )
        level = DiagnosticStatus.OK if state == 'active' else DiagnosticStatus.WARN
        return diagnostic_status(self._runtime, 'lifecycle', level, state)

    def destroy_node(self) -> None:
        """As that of the base."""
        self._transitions.shutdown(wait=False, cancel_futures=True)  # one is asked for, and the node was never managed
        self._is_managed.set()
        super().destroy_node()

    async def answer_change_state(self, request: Any, response: Any) -> Any:
        """As the design has it: when the transition is over."""
        done = Future(executor=self.executor)

        def change() -> None:
            try:
                self._change_state(request, response)
                if self._error is not None:
                    self._report(self._error)
            except RCLError:  # no such transition now; rclpy would not answer at all
                response.success = False
            finally:
                self._runtime.post(lambda: done.set_result(None))

        try:
            self._transitions.submit(change)
        except RuntimeError:  # the process ends
            response.success = False
            return response
        await done
        return response

    def _report(self, error: Exception) -> None:
        if isinstance(error, FlexbtError):
            self.get_logger().error(f'{self.state} because of an error: {error}')
        else:
            self._runtime.report_fault(error, 'a transition')

    def _end(self) -> None:
        """The last transition; after the one that goes on."""
        self._is_managed.set()  # also when it has not come so far

        def shut_down() -> None:
            with contextlib.suppress(RCLError):  # it is finalized
                self.trigger_shutdown()
            self._scope.close()

        self._transitions.submit(shut_down).result()
        self._transitions.shutdown()


def run_managed_node(
    name: str,
    configure: Maker,
    args: list[str] | None = None,
    waiting: Waiting = lambda _: None,
    parameters: Declare = lambda _: None,
    about: str | None = None,
) -> int:
    """:func:`run_node` for a managed node; see :meth:`ManagedNode.manage` for what is given to it."""

    def setup(runtime: NodeRuntime) -> None:
        assert isinstance(runtime.node, ManagedNode)
        runtime.node.manage(runtime, configure, waiting, parameters)

    return run_node(name, setup, args, ManagedNode, about)
