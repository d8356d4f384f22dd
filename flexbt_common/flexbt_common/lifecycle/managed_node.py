# SPDX-License-Identifier: BSD-3-Clause
"""A managed node: its transitions, the parts that it creates when it is configured, and its diagnostics.

The interface is that of https://design.ros2.org/articles/node_lifecycle.html.
"""

from __future__ import annotations

import contextlib
import threading
from collections.abc import Callable, Hashable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from typing import Any, Final, Protocol, TypeVar

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from lifecycle_msgs.srv import ChangeState, GetState
from rcl_interfaces.msg import ParameterDescriptor
from rclpy.action import ActionClient, ActionServer
from rclpy.action.server import RCLError
from rclpy.clock import Clock, ClockType
from rclpy.lifecycle import LifecycleNode, LifecycleNodeMixin, LifecycleState, TransitionCallbackReturn
from rclpy.node import Node
from rclpy.task import Future

from flexbt_common.middleware.rclpy_private import release_lifecycle
from flexbt_common.names import CLOCK
from flexbt_common.runtime.clock_watch import GOES_ON, clock_health
from flexbt_common.runtime.node_runtime import CALL_SECONDS, LargeQueueNode, NodeRuntime, Runtime, run_node
from flexbt_common.runtime.parameters import refuse_while_configured
from flexbt_core.clock.clock import Timer
from flexbt_core.errors import FlexbtError
from flexbt_core.values.text import one_line, sanitize_for_message

from .liveliness import LivelinessToken


class ExtendedLifecycleNode(LargeQueueNode, LifecycleNode):
    """A lifecycle node with overridable answers: :meth:`answer_get_state` and :meth:`answer_change_state` extend
    rclpy's ``self._get_state`` and ``self._change_state``. On an impossible transition rclpy raises RCLError."""

    def __init__(self, name: str, **options: Any) -> None:
        Node.__init__(self, name, **options)
        LifecycleNodeMixin.__init__(self)
        served = {service.srv_type: service for service in self.services}
        for service in served.values():
            self.resend_answers(service)  # rclpy does not create the lifecycle services by create_service
        self._get_state = served[GetState].callback
        self._change_state = served[ChangeState].callback
        served[GetState].callback = self.answer_get_state
        served[ChangeState].callback = self.answer_change_state

    @property
    def state(self) -> str:
        """Standard name of the state or of the present transition: 'unconfigured', 'configuring' ..."""
        return str(self._get_state(GetState.Request(), GetState.Response()).current_state.label)

    def answer_get_state(self, request: Any, response: Any) -> Any:
        """Answer with rclpy's state."""
        return self._get_state(request, response)

    def answer_change_state(self, request: Any, response: Any) -> Any:
        """Make the transition and answer whether it succeeded; a coroutine if it takes long."""
        raise NotImplementedError

    def destroy_node(self) -> None:
        """Destroy the node with its lifecycle services, which rclpy leaves in the graph until Python collects them."""
        super().destroy_node()
        release_lifecycle(self)


# A managed node, as lifecycle managers and launch files know it (https://design.ros2.org/articles/node_lifecycle.html).
#
# rclpy's ``LifecycleNode`` makes a whole transition within one callback. Our transitions must wait for running work,
# which needs the executor to stop. So a separate thread makes the transitions one after the other, and the node answers
# ``change_state`` when the transition is over. Meanwhile it answers all other requests.
#
# The parts that exist in each state:
#
# - unconfigured: parameters, which can be set; the lifecycle services; the parts that ``waiting`` creates
# - inactive: the parts that ``configure`` creates; they refuse to work
# - active: the same parts, which work
# - finalized: the lifecycle services, until the process ends
#
# The node is alive for others in every state (:mod:`flexbt_common.lifecycle.liveliness`), and ready when it is active.
#
# An error in a transition is logged. The node is unconfigured afterwards and can be configured again.

DEACTIVATED: Final = 'was deactivated'
SHUTTING_DOWN: Final = 'is shutting down'
"""Reasons for stopped work; each follows a subject."""

STOP_SECONDS: Final = 10.0
"""Time that a node being deactivated waits for running work to stop, s."""

_AUTOSTART: Final = ParameterDescriptor(
    description='whether the node configures and activates itself; if not, a lifecycle manager has to',
    read_only=True,
)


class Managed(Protocol):
    """A configured node. Called off the executor thread."""

    def activate(self) -> None:
        """Start to work."""

    def deactivate(self, why: str, refusal: str, within: float) -> None:
        """Refuse new work and stop running work; return when it has stopped and all results are sent.

        ``why`` is the text for stopped work, ``refusal`` that for refused work; they follow a subject, as in 'the
        server was deactivated'. ``within`` is in seconds of wall time.

        Raises:
            FlexbtError: some work did not halt in this time.
        """


Maker = Callable[[Runtime, str], Managed]
"""A function that creates the parts of the configured node. Its arguments are a runtime that ends with them, and the
reason to refuse work until activation: '' if activation follows at once, so that early requests are not refused."""

Waiting = Callable[[Runtime], object]
Declare = Callable[[Node], object]


def inactive(node: Node) -> str:
    """Return the reason why an inactive node refuses to work; it follows a subject."""
    return f'is inactive; activate it (ros2 lifecycle set {node.get_fully_qualified_name()} activate)'


def unconfigured(node: Node) -> str:
    """Return the reason why an unconfigured node refuses to work; it follows a subject."""
    error = node.error if isinstance(node, ManagedNode) else None
    why = '' if error is None else f' because of an error: {one_line(str(error) or type(error).__name__, 1000)}'
    name = node.get_fully_qualified_name()
    return f'is unconfigured{why}; configure and activate it (ros2 lifecycle set {name} configure)'


class ManagedNode(ExtendedLifecycleNode):
    """The managed node of a :class:`NodeRuntime`; :meth:`manage` defines its parts."""

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
        """Start the node, and configure and activate it if the parameter ``autostart`` is true.

        ``configure`` creates the parts of the node. ``waiting`` creates the parts that exist while it is unconfigured,
        on a runtime that ends with this state. Both are called off the executor thread. ``parameters`` declares the
        parameters that can be set before the first configuration; ``configure`` declares them too.

        Raises:
            FlexbtError: an error of ``configure`` or ``activate`` on autostart.
        """
        self._runtime = runtime
        self._configure = configure
        self._waiting = waiting
        self._token = LivelinessToken(runtime)  # alive in every state, ready when active
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
        if self._is_starting:  # the process is ending: do not configure
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

    def _enter(self, make: Callable[[Runtime], Any]) -> None:
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
        """Destroy the node and end its thread of transitions."""
        self._transitions.shutdown(wait=False, cancel_futures=True)  # one is requested, and the node was never managed
        self._is_managed.set()
        super().destroy_node()

    async def answer_change_state(self, request: Any, response: Any) -> Any:
        """Answer when the transition is over, as the design requires."""
        done = Future(executor=self.executor)

        def change() -> None:
            try:
                self._change_state(request, response)
                if self._error is not None:
                    self._report(self._error)
            except RCLError:  # no valid transition; rclpy would not answer
                response.success = False
            finally:
                self._runtime.post(lambda: done.set_result(None))

        try:
            self._transitions.submit(change)
        except RuntimeError:  # the process is ending
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
        """Make the last transition, after the present one."""
        self._is_managed.set()  # even if the start is not complete

        def shut_down() -> None:
            with contextlib.suppress(RCLError):  # already finalized
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
    """Run a managed node as :func:`run_node` does; :meth:`ManagedNode.manage` describes the arguments."""

    def setup(runtime: NodeRuntime) -> None:
        assert isinstance(runtime.node, ManagedNode)
        runtime.node.manage(runtime, configure, waiting, parameters)

    return run_node(name, setup, args, ManagedNode, about)


# A part of a node that ends before it: the parts that a managed node creates when it is configured.

T = TypeVar('T')


class NodeScope(Runtime):
    """A :class:`Runtime` within that of a node, its host: it ends before the host, and another may follow.

    Everything made on the node since the scope began is removed when the scope ends, without further bookkeeping:
    callbacks registered with :meth:`on_close` are called, posted work is dropped, and every entity is destroyed.
    Scopes of one node follow each other and do not overlap. Everything else belongs to the host.
    """

    def __init__(self, host: NodeRuntime) -> None:
        super().__init__()
        self._host = host
        self.node = host.node
        self.name = host.name
        self.nodes = host.nodes
        self.default_context = host.default_context
        self.simulated_time = host.simulated_time
        self.listening_time = host.listening_time
        self.clock = host.clock
        self.steady = host.steady
        self.health = host.health
        self._before = host.call(self._entities)
        host.on_fault(self._report_fault)

    @property
    def on_executor_thread(self) -> bool:
        return self._host.on_executor_thread

    def post(self, fn: Callable[[], object]) -> None:
        self._host.post(partial(self._run, fn))

    def post_at(self, when: float, fn: Callable[[], object]) -> Timer:
        return self._host.post_at(when, partial(self._run, fn))

    def call_near(self, when: float, tolerance: float, fn: Callable[[], object]) -> None:
        self._host.call_near(when, tolerance, partial(self._run, fn))

    def _run(self, fn: Callable[[], object]) -> None:
        if not self.closed:
            fn()

    def run_or_post(self, fn: Callable[[], object]) -> None:
        self._host.run_or_post(partial(self._run, fn))

    def call(self, fn: Callable[[], T], timeout: float = CALL_SECONDS) -> T:
        def run() -> T:
            if self.closed:
                raise RuntimeError(f'this part of node {self.name} has ended; nothing can be run for it')
            return fn()

        return self._host.call(run, timeout)

    def once(self, key: Hashable, make: Callable[[NodeRuntime], T]) -> T:
        """Return the shared object of the host for ``key``; it outlives the scope."""
        before = self._entities()
        made = self._host.once(key, make)
        new = {entity: destroy for entity, destroy in self._entities().items() if entity not in before}
        # Some of the earlier entities may have been destroyed meanwhile.
        self._before = {entity: destroy for entity, destroy in self._before.items() if entity in before} | new
        return made

    def forget(self, key: Hashable) -> None:
        self._host.forget(key)

    def report_fault(self, error: BaseException, where: str = 'a callback') -> None:
        self._host.report_fault(error, where)

    def fail(self, why: str) -> None:
        self._host.fail(why)

    def abort(self, problem: str) -> None:
        self._host.abort(problem)

    def close(self) -> None:
        """End the scope. May be called twice, not from the executor thread."""
        callbacks, self._on_close = self._on_close, []
        self._host.close_all(callbacks)
        if not self.closed:
            self._host.call(self._end)

    def _report_fault(self, error: BaseException) -> None:
        for observer in self._on_fault:
            observer(error)

    def _end(self) -> None:
        self._closed.set()
        self._host._on_fault.remove(self._report_fault)
        # What has ended is freed: finalizers of its parts keep this object.
        self._on_fault.clear()
        self._shared.clear()
        for entity, destroy in self._entities().items():
            if entity not in self._before:
                destroy(entity)

    def _entities(self) -> dict[Any, Callable[[Any], object]]:
        """Return the entities of the node, with the functions that destroy them.

        Event handlers end with their topic. What belongs to the clock of the node is not among them: the subscription
        to the simulated time, and the timer.
        """
        node: Any = self.node
        actions = [waitable for waitable in node.waitables if isinstance(waitable, ActionServer | ActionClient)]
        topics = [subscription for subscription in node.subscriptions if subscription.topic_name != CLOCK]
        timers = [timer for timer in node.timers if timer is not self.clock.timer]
        return {
            **dict.fromkeys(actions, _destroy_action),
            **dict.fromkeys(topics, node.destroy_subscription),
            **dict.fromkeys(node.publishers, node.destroy_publisher),
            **dict.fromkeys(node.clients, node.destroy_client),
            **dict.fromkeys(node.services, node.destroy_service),
            **dict.fromkeys(timers, node.destroy_timer),
            **dict.fromkeys(node.guards, node.destroy_guard_condition),
        }


def _destroy_action(action: ActionServer | ActionClient) -> None:
    action.destroy()


# Diagnostics on ``/diagnostics``, for tools that monitor whole robots: once a second, while it has subscribers.

DIAGNOSTICS_TOPIC: Final = '/diagnostics'
DIAGNOSTICS_PERIOD: Final = 1.0


class DiagnosticsPublisher:
    """A publisher of the diagnostics that ``entries`` returns; both are used on the executor thread.

    If time is simulated, an entry reports the state of the clock.
    """

    def __init__(self, runtime: Runtime, entries: Callable[[], Sequence[DiagnosticStatus]]) -> None:
        self._runtime = runtime
        self._entries = entries
        self._publisher = runtime.node.create_publisher(DiagnosticArray, DIAGNOSTICS_TOPIC, 10)
        runtime.node.create_timer(DIAGNOSTICS_PERIOD, self._publish, clock=Clock(clock_type=ClockType.STEADY_TIME))

    def _publish(self) -> None:
        if self._publisher.get_subscription_count() == 0:
            return
        array = DiagnosticArray(status=[*self._entries(), *self._clock()])
        array.header.stamp = self._runtime.clock.stamp()
        self._publisher.publish(array)

    def _clock(self) -> list[DiagnosticStatus]:
        if not self._runtime.node.get_clock().ros_time_is_active:
            return []
        problem = clock_health(self._runtime).problem
        level = DiagnosticStatus.WARN if problem else DiagnosticStatus.OK
        return [diagnostic_status(self._runtime, 'simulated time', level, problem or GOES_ON)]


def diagnostic_status(
    runtime: Runtime, what: str, level: bytes, message: str, values: Mapping[str, str] | None = None
) -> DiagnosticStatus:
    """Return the diagnostic message for one part of a node; ``level`` is a constant of DiagnosticStatus."""
    return DiagnosticStatus(
        level=level,
        name=f'{runtime.node.get_fully_qualified_name()}: {what}',
        message=sanitize_for_message(message),
        values=[KeyValue(key=key, value=value) for key, value in (values or {}).items()],
    )
