# SPDX-License-Identifier: BSD-3-Clause
"""A ROS node with its executor thread and clocks, and the orderly start and end of a process.

The rule of this code base: create, call and destroy every rclpy entity on the executor thread. Publishing is the
exception, because it is thread-safe. The reason: rclpy's clients fill their table of pending requests only after a
request was sent. If another thread receives the answer before that, the answer is lost. :meth:`NodeRuntime.post` and
:meth:`NodeRuntime.call` run a function on the executor thread.

A node that cannot continue calls :meth:`NodeRuntime.abort`; the runtime calls it when the executor thread has ended for
any reason. Other nodes then no longer see the node as alive, and its process ends with a nonzero exit code.

A node ends in this order, silently in every situation:

1. The components, in reverse order of their :meth:`NodeRuntime.on_close`, while callbacks still run.
2. rclpy's default context, which users' code uses.
3. The executor and its thread; then, as soon as others have received what was published, the node and the context.

If a process has several runtimes, the components of all of them end first.
"""

from __future__ import annotations

import contextlib
import faulthandler
import gc
import itertools
import logging
import math
import os
import signal
import sys
import threading
import time
import traceback
from abc import ABC, abstractmethod
from collections import deque
from collections.abc import Callable, Hashable, Iterator, Mapping, Sequence
from concurrent.futures import CancelledError, Future
from functools import cached_property, partial
from time import monotonic
from typing import Any, Final, TypeVar

import rclpy
from rcl_interfaces.msg import ParameterDescriptor, SetParametersResult
from rclpy.action import ActionClient, ActionServer
from rclpy.action.server import RCLError
from rclpy.callback_groups import CallbackGroup, ReentrantCallbackGroup
from rclpy.duration import Duration
from rclpy.event_handler import PublisherEventCallbacks, SubscriptionEventCallbacks
from rclpy.exceptions import (
    InvalidHandle,
    InvalidParameterTypeException,
    InvalidParameterValueException,
    ParameterNotDeclaredException,
)
from rclpy.executors import Executor, ExternalShutdownException
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.qos import QoSProfile
from rclpy.service import Service
from rclpy.signals import SignalHandlerOptions
from rclpy.utilities import remove_ros_args

from flexbt_common.errors import TopicTypeError
from flexbt_common.middleware import rclpy_private
from flexbt_common.middleware.default_context import DefaultContext
from flexbt_common.middleware.fastdds import end_callbacks, release_large_messages
from flexbt_common.middleware.qos_misfits import QosMisfits
from flexbt_common.middleware.received_messages import COMPLAINT_SECONDS
from flexbt_common.names import service_qos
from flexbt_core.clock.clock import SteadyClock, Timer, TimerQueue
from flexbt_core.clock.rates import RepeatedReports
from flexbt_core.clock.waiting import CoalescedTimers
from flexbt_core.values.text import escape_lines
from flexbt_core.values.text_files import file_problem

from .health import LATE_SECONDS, Hang, Health
from .node_executor import Later, NodeExecutor, StockNodeExecutor, make_executor
from .node_log import NodeLogger, StandardStreams, watchdog_descriptor
from .parameters import (
    bounded,
    is_parameter_service,
    refused_declaration,
    refused_setting,
    undeclared,
    unknown_parameters,
)
from .ros_clock import HandledTime, RosClock, SimulatedTime

T = TypeVar('T')

_CLOSE_SECONDS = 1.7
"""Time to close, s. A process ends within 2 s of its signal; interpreter and middleware need the rest."""

_HELP = """\
usage: {name} [--ros-args -p PARAMETER:=VALUE ... -r __ns:=/NAMESPACE ...]

{about}

The parameters are in docs/reference/executables.md; ros2 param describe tells them of a node that runs."""

CALL_SECONDS = 30.0
"""Default time-out of a call to the executor thread, s. Creating the entities of a node can take many seconds when a
whole fleet starts on one machine."""

RECEIVED_SECONDS: Final = 0.3
"""Maximum time that the end of a node waits for readers, s. One that has just crashed or is stopped takes all of it."""

_FAULTS_IN_A_ROW = 10
_FAULT_PAUSE_SECONDS = 0.05


UNSENT_SECONDS: Final = 0.09
"""Minimum duration of a failed attempt to send an answer, s: rmw_fastrtps waits 0.1 s for the reader."""

AGAIN_SECONDS: Final = (0.2, 0.5, 1.0, 3.0)
"""Delays between the attempts to send an answer, s of wall time. A client ignores a duplicate answer."""

MOST_UNSENT: Final = 4
"""Maximum number of unsent answers of a service that are retried. Each attempt blocks the executor for 0.1 s."""


class AnswerResender:
    """A sender that retries the answers of a service until their reader is discovered.

    A request may arrive before its client has been discovered as a reader of answers, mainly on a busy computer. The
    middleware then does not send the answer, rclpy issues a Python warning, and clients such as BasicNavigator of
    nav2_simple_commander wait forever.
    """

    def __init__(self, service: Service, later: Later) -> None:
        self._service = service
        self._later = later
        self._unsent = 0

    def send(self, response: Any, header: Any) -> None:
        """Send an answer, and retry it after AGAIN_SECONDS if it stays unsent. Executor thread only."""
        if self._is_sent(response, header) or self._unsent == MOST_UNSENT:
            return
        self._unsent += 1
        pauses = iter(AGAIN_SECONDS)

        def send_later() -> None:
            pause = next(pauses, None)
            if pause is None:
                self._unsent -= 1
            else:
                self._later(pause, send_again)

        def send_again() -> None:
            with contextlib.suppress(InvalidHandle, RCLError):  # the service is gone by now, or the client
                if not self._is_sent(response, header):
                    send_later()
                    return
            self._unsent -= 1

        send_later()

    def _is_sent(self, response: Any, header: Any) -> bool:
        began = monotonic()
        Service.send_response(self._service, response, header)
        return monotonic() - began < UNSENT_SECONDS


class LargeQueueNode(Node):
    """A node with robust services, parameters and logs.

    Services have the queue depth of :func:`service_qos` by default, and retry unsent answers. The parameter services
    answer requests with any parameters. Log texts are escaped and bounded (:class:`.node_log.NodeLogger`).
    """

    def get_logger(self) -> NodeLogger:
        """See :meth:`rclpy.node.Node.get_logger`."""
        if self._bounded_logger is None:  # the constructor of the base class calls this
            self._bounded_logger = NodeLogger(super().get_logger().name)
        return self._bounded_logger

    _bounded_logger: NodeLogger | None = None

    @cached_property
    def default_callback_group(self) -> CallbackGroup:
        """Reentrant group, so that a callback that awaits does not block others, such as STOP. One thread runs all."""
        return ReentrantCallbackGroup()

    @cached_property
    def qos_misfits(self) -> QosMisfits:
        """Topics on which no messages are exchanged because of incompatible QoS."""
        return QosMisfits(self)

    def create_subscription(self, msg_type: Any, topic: str, *args: Any, **options: Any) -> Any:
        """See :meth:`rclpy.node.Node.create_subscription`. Also raises TopicTypeError."""
        events = options.pop('event_callbacks', None) or SubscriptionEventCallbacks()
        watched = self.qos_misfits.watched(events, topic)
        with self._told_types(msg_type, topic):
            return super().create_subscription(msg_type, topic, *args, event_callbacks=watched, **options)

    def create_publisher(self, msg_type: Any, topic: str, *args: Any, **options: Any) -> Any:
        """See :meth:`rclpy.node.Node.create_publisher`. Also raises TopicTypeError."""
        events = options.pop('event_callbacks', None) or PublisherEventCallbacks()
        watched = self.qos_misfits.watched(events, topic)
        with self._told_types(msg_type, topic):
            return super().create_publisher(msg_type, topic, *args, event_callbacks=watched, **options)

    def declare_parameters(self, namespace: str, parameters: Any, ignore_override: bool = False) -> list[Parameter]:
        """See :meth:`rclpy.node.Node.declare_parameters`. The error of a refusal explains what to write instead."""
        declared = [(*one, ParameterDescriptor()) if len(one) == 2 else one for one in parameters]
        try:
            return list(super().declare_parameters(namespace, declared, ignore_override))
        except (InvalidParameterTypeException, InvalidParameterValueException) as error:
            given = {} if ignore_override else rclpy_private.given_parameters(self)
            whole = [one for one in declared if len(one) == 3]
            why = refused_declaration(f'{namespace}.' if namespace else '', whole, given)
            error.args = (why,) if why else error.args
            raise

    def set_parameters_atomically(self, parameter_list: list[Parameter]) -> SetParametersResult:
        """See :meth:`rclpy.node.Node.set_parameters_atomically`. A refusal explains what to write instead."""
        try:
            result = super().set_parameters_atomically(parameter_list)
        except ParameterNotDeclaredException as error:
            error.args = (undeclared(self, parameter_list),)
            raise
        if not result.successful:
            result.reason = refused_setting(self, parameter_list) or result.reason
        return result

    def set_parameters(self, parameter_list: list[Parameter]) -> list[SetParametersResult]:
        """See :meth:`rclpy.node.Node.set_parameters`. A refusal explains what to write instead."""
        return [self.set_parameters_atomically([parameter]) for parameter in parameter_list]

    @contextlib.contextmanager
    def _told_types(self, msg_type: Any, topic: str) -> Iterator[None]:
        """Raise TopicTypeError where rcl reports an allocator error because the topic has another type here."""
        try:
            yield
        except RuntimeError as error:
            name = self.resolve_topic_name(topic)
            type = f'{msg_type.__module__.partition(".")[0]}/msg/{msg_type.__name__}'
            known = dict(self.get_topic_names_and_types()).get(name, [])
            if others := [one for one in known if one != type]:
                raise TopicTypeError(name, type, others) from error
            raise

    @property
    def executor(self) -> Any:
        """Executor that spins the node. If users' code adds the node to another executor, that becomes its guest."""
        return Node.executor.fget(self)

    @executor.setter
    def executor(self, executor: Executor | None) -> None:
        own = self.executor
        if isinstance(own, NodeExecutor | StockNodeExecutor) and executor not in (own, None):
            own.guests.admit(executor, self)
        else:
            Node.executor.fset(self, executor)

    def create_service(
        self, srv_type: Any, srv_name: str, callback: Any, *, qos_profile: QoSProfile | None = None, **options: Any
    ) -> Any:
        """See :meth:`rclpy.node.Node.create_service`."""
        if is_parameter_service(srv_type):
            callback = bounded(srv_type, callback, self)
        qos_profile = qos_profile or service_qos()
        service: Any = super().create_service(srv_type, srv_name, callback, qos_profile=qos_profile, **options)
        self.resend_answers(service)
        return service

    def resend_answers(self, service: Any) -> None:
        """Make a service of this node retry unsent answers; see :class:`AnswerResender`."""

        def later(seconds: float, fn: Callable[[], object]) -> None:
            if self.executor is not None:
                self.executor.later(seconds, fn)

        service.send_response = AnswerResender(service, later).send


class Runtime(ABC):
    """The interface of a runtime for the components of a node. It belongs to the whole node (:class:`NodeRuntime`), or
    to a part of the node that may end earlier (:class:`flexbt_common.lifecycle.managed_node.NodeScope`)."""

    node: LargeQueueNode
    name: str
    nodes: list[Node]
    default_context: DefaultContext
    simulated_time: SimulatedTime
    listening_time: HandledTime
    clock: RosClock
    steady: SteadyClock
    health: Health

    def __init__(self) -> None:
        self._closed = threading.Event()
        self._on_close: list[Callable[[], object]] = []
        self._on_fault: list[Callable[[BaseException], None]] = []
        self._shared: dict[Hashable, Any] = {}

    @property
    @abstractmethod
    def on_executor_thread(self) -> bool:
        """True if the caller is on the executor thread."""

    @property
    def closed(self) -> bool:
        """True if the runtime has begun to end. Functions posted from then on are dropped."""
        return self._closed.is_set()

    @abstractmethod
    def post(self, fn: Callable[[], object]) -> None:
        """Run ``fn`` on the executor thread soon, in the order of posting; from any thread.

        Exceptions are logged and passed to the observers of :meth:`on_fault`. After the end nothing runs any more.
        """

    @abstractmethod
    def post_at(self, when: float, fn: Callable[[], object]) -> Timer:
        """Run ``fn`` on the executor thread at the time ``when`` of the steady clock; from any thread.

        After the timer was cancelled on the executor thread, ``fn`` does not run, even if it was due already.
        """

    def post_in(self, seconds: float, fn: Callable[[], object]) -> Timer:
        """Run ``fn`` on the executor thread after this many seconds of wall time, as :meth:`post_at`."""
        return self.post_at(self.steady.now() + seconds, fn)

    @abstractmethod
    def call_near(self, when: float, tolerance: float, fn: Callable[[], object]) -> None:
        """Run ``fn`` once, at most ``tolerance`` seconds before or after the time ``when`` of the steady clock.

        ``fn`` runs as soon as the executor is awake in that period; at its end, the executor is woken for ``fn``.
        Executor thread only.
        """

    @abstractmethod
    def run_or_post(self, fn: Callable[[], object]) -> None:
        """Run ``fn`` at once on this thread if the executor is idle; otherwise :meth:`post` it.

        Do not call this on the executor thread. Functions that were posted before run first, and nothing runs on the
        executor thread while ``fn`` runs. Use this on a thread that has to wait for ``fn`` anyway: waking the executor
        thread takes longer than most functions do.
        """

    @abstractmethod
    def call(self, fn: Callable[[], T], timeout: float = CALL_SECONDS) -> T:
        """Run ``fn`` on the executor thread and return its value, or raise its exception.

        Raises:
            TimeoutError: ``fn`` was not done within ``timeout`` seconds (it may still run).
            RuntimeError: the runtime is closed.
        """

    @abstractmethod
    def once(self, key: Hashable, make: Callable[[NodeRuntime], T]) -> T:
        """Return the shared object of the node for ``key``, made with ``make`` on first use. Executor thread only.

        It outlives a part of the node, and only those of its entities that ``make`` creates do. One that creates
        others later has to be :meth:`shared`.
        """

    def shared(self, key: Hashable, make: Callable[[], T]) -> T:
        """Return the object for ``key`` that ends with this runtime, made with ``make`` on first use. Executor thread
        only."""
        if key not in self._shared:
            self._shared[key] = make()
        made: T = self._shared[key]
        return made

    @abstractmethod
    def forget(self, key: Hashable) -> None:
        """Forget the object that :meth:`once` made for this key; the next use makes a new one."""

    def on_close(self, fn: Callable[[], object]) -> None:
        """Call ``fn`` at the end, on the closing thread, in reverse order, while callbacks still run.

        It must return soon: a process has 2 s to end.
        """
        self._on_close.append(fn)

    def cancel_on_close(self, fn: Callable[[], object]) -> None:
        """Undo :meth:`on_close`. A second call, or one after the end, has no effect."""
        with contextlib.suppress(ValueError):
            self._on_close.remove(fn)

    def on_fault(self, fn: Callable[[BaseException], None]) -> None:
        """Call ``fn`` with each exception reported by :meth:`report_fault`, on the reporting thread."""
        self._on_fault.append(fn)

    @abstractmethod
    def report_fault(self, error: BaseException, where: str = 'a callback') -> None:
        """Log an exception that escaped from a callback, and notify the observers. From any thread. Never raises.

        Of exceptions of the same type from the same line, one is reported every COMPLAINT_SECONDS: messages of other
        nodes may cause any number of them.
        """

    @abstractmethod
    def fail(self, why: str) -> None:
        """Log that the node has failed its purpose: the process will end with exit code 1."""

    @abstractmethod
    def abort(self, problem: str) -> None:
        """End the process with exit code 1, since the node cannot continue. Other nodes no longer see it as alive.

        ``problem`` is the reason. From any thread.
        """


class NodeRuntime(Runtime):
    """One node, one executor thread, two clocks.

    ``node`` is the rclpy node, ``clock`` its clock (simulated time under ``use_sim_time``). ``steady`` is the machine's
    monotonic clock, for deadlines of communication. ``listening_time`` measures how long others have been silent.
    ``health`` monitors the threads that must respond for the node to count as alive: the executor, and those that
    components register.
    """

    def __init__(
        self,
        name: str,
        *,
        args: Sequence[str] | None = None,
        parameters: Mapping[str, Any] | None = None,
        namespace: str | None = None,
        node_class: type[LargeQueueNode] = LargeQueueNode,
    ) -> None:
        """Start a node in its own context.

        ``args`` are command line arguments (``--ros-args`` ...), None for those of the process. ``parameters``
        override parameters in the arguments.
        """
        super().__init__()
        self.has_failed = False
        """True if the process ends with exit code 1; see :meth:`fail`."""
        self.are_parameters_declared = True
        """True if all parameters are declared, so that others are unknown. False if a managed node refused one."""
        self._on_failure: list[Callable[[], object]] = []
        self._is_closing = False
        self._posted: deque[Callable[[], object]] = deque()
        self._timers = TimerQueue()
        self._coalesced = CoalescedTimers()
        self._calls: set[Future[Any]] = set()
        self._lock = threading.RLock()  # reentrant: destructors may post while it is held
        self._context = rclpy.Context()
        rclpy.init(
            args=None if args is None else list(args),
            context=self._context,
            signal_handler_options=SignalHandlerOptions.NO,
        )
        try:
            overrides = [Parameter(key, value=value) for key, value in (parameters or {}).items()]
            release_large_messages()
            self.node = node_class(name, context=self._context, namespace=namespace, parameter_overrides=overrides)
        except BaseException:
            rclpy.try_shutdown(context=self._context)
            raise
        self.default_context = DefaultContext(args, self.node)
        """rclpy's default context. Components that run users' code open it; it ends with the runtime."""
        self.name = self.node.get_name()
        self.nodes: list[Node] = [self.node]
        """Nodes to destroy at the end, the last one first."""
        self.further: list[NodeRuntime] = []
        """Other runtimes of this process, which end with this one. The process arguments also apply to their nodes."""
        self.is_at_rest = False
        """True if all components have ended, and only the nodes are still to be removed from the graph."""
        self.steady = SteadyClock(lambda error: self.post(lambda: self.report_fault(error, 'a timer of wall time')))
        self._reports = RepeatedReports(COMPLAINT_SECONDS, self.steady.now)
        self.health = Health(self.steady)
        self.health.on_hang(self._log_hang)
        for warning in rclpy_private.warnings():
            self.node.get_logger().warning(warning)
        self._executor = make_executor(self.node, self._on_escaped, self.health.check_pause, self.post_in)
        self.simulated_time = self._executor.simulated_time
        self.listening_time = self._executor.listening_time
        self._doorbell = self._executor.doorbell
        self._faults: deque[float] = deque(maxlen=_FAULTS_IN_A_ROW)
        self.clock = RosClock(self)
        self._pinged_at = 0.0
        self._thread = threading.Thread(target=self._spin, name=f'{name}_executor', daemon=True)
        self.health.register('the executor', self._ping, self._thread)
        self._thread.start()

    @classmethod
    @contextlib.contextmanager
    def open(
        cls,
        name: str,
        *,
        args: Sequence[str] | None = (),
        parameters: Mapping[str, Any] | None = None,
        namespace: str | None = None,
        node_class: type[LargeQueueNode] = LargeQueueNode,
    ) -> Iterator[NodeRuntime]:
        """Provide a runtime for the length of a ``with`` block; by default without the arguments of the process."""
        runtime = cls(name, args=args, parameters=parameters, namespace=namespace, node_class=node_class)
        try:
            yield runtime
        finally:
            runtime.close()

    @property
    def on_executor_thread(self) -> bool:
        return threading.current_thread() is self._thread

    def post(self, fn: Callable[[], object]) -> None:
        with self._lock:
            if not self.closed:
                self._post_locked(fn)

    def post_at(self, when: float, fn: Callable[[], object]) -> Timer:
        with self._lock:
            timer = self._timers.add(when, fn)
            if self._timers.is_first(timer) and not self.closed and not self.on_executor_thread:
                self._doorbell.trigger()
        return timer

    def call_near(self, when: float, tolerance: float, fn: Callable[[], object]) -> None:
        self._coalesced.add(when, tolerance, fn)
        if not self.on_executor_thread:  # the executor thread sleeps while another one has its turn
            self._doorbell.trigger()

    def repeat_near(self, period: float, tolerance: float, fn: Callable[[], object]) -> None:
        """Run ``fn`` about every ``period`` seconds until the end, each time as :meth:`call_near` does."""

        def call() -> None:
            self.call_near(self.steady.now() + period, tolerance, call)
            fn()

        self.call_near(self.steady.now() + period, tolerance, call)

    def run_or_post(self, fn: Callable[[], object]) -> None:
        if self.closed or self._posted or not self._executor.run_here(fn):  # functions posted before run first
            self.post(fn)

    def call(self, fn: Callable[[], T], timeout: float = CALL_SECONDS) -> T:
        if self.on_executor_thread or self._executor.is_lent:
            return fn()
        future: Future[T] = Future()

        def run() -> None:
            if not future.set_running_or_notify_cancel():
                return
            try:
                future.set_result(fn())
            except BaseException as error:
                future.set_exception(error)

        with self._lock:
            if self.closed:
                raise RuntimeError(f'node {self.name} is closed; nothing can be run on its executor')
            self._post_locked(run)
            self._calls.add(future)
        try:
            return future.result(timeout)
        except CancelledError:
            raise RuntimeError(f'node {self.name} was closed before {_called(fn)} was run') from None
        except TimeoutError:
            if future.done():  # fn itself raised it
                raise
            future.cancel()
            what = f'the executor of node {self.name} did not get to {_called(fn)}'
            raise TimeoutError(f'{what} within {timeout:g} s') from None
        finally:
            with self._lock:
                self._calls.discard(future)

    def once(self, key: Hashable, make: Callable[[NodeRuntime], T]) -> T:
        return self.shared(key, partial(make, self))

    def forget(self, key: Hashable) -> None:
        self._shared.pop(key, None)

    def report_fault(self, error: BaseException, where: str = 'a callback') -> None:
        held = self._reports.held_before((type(error), where, _place_of(error)))
        if held is None:
            return
        text = ''.join(traceback.format_exception(error)).rstrip()
        again = f' ({held} times more since this was reported)' if held else ''
        self.node.get_logger().error(f'{where} raised{again}; the node continues:\n{text}')
        for observer in self._on_fault:
            try:
                observer(error)
            except Exception as further:
                self.node.get_logger().error(f'a fault observer raised {further!r}')

    def fail(self, why: str) -> None:
        self.has_failed = True
        self.node.get_logger().error(why)

    def on_failure(self, fn: Callable[[], object]) -> None:
        """Call ``fn`` when :meth:`abort` is called, on the same thread. ``fn`` must not block."""
        self._on_failure.append(fn)

    def abort(self, problem: str) -> None:
        self.has_failed = True
        try:
            self.health.fail(problem)
            self.node.get_logger().fatal(f'the node cannot continue: {problem}')
        finally:  # even if that fails, for example without free memory
            for fn in list(self._on_failure):
                fn()

    def close(self) -> None:
        """End everything in the order documented above. A second call has no effect. Not on the executor thread."""
        runtimes = (*reversed(self.further), self)
        for runtime in runtimes:
            runtime.close_components()
        self.is_at_rest = True
        for runtime in runtimes:
            runtime.leave_graph()

    def leave_graph(self) -> None:
        """End executor, nodes and context: the second part of the end."""
        with self._lock:
            if self._is_closing:
                return
            self._is_closing = True
            self._closed.set()
        self.default_context.close()  # first, because a callback may wait in it
        self.steady.close()
        self._doorbell.trigger()  # the thread checks for the end only after a wait
        self._thread.join()
        self._executor.shutdown()
        with self._lock:
            for future in self._calls:
                future.cancel()
        end_callbacks(self.node)
        for waitable in list(self.node.waitables):
            if isinstance(waitable, ActionServer | ActionClient):
                waitable.destroy()  # destroy_node does not, and the node would stay in the graph
        self._wait_for_readers()
        for node in reversed(self.nodes):
            node.destroy_node()
        rclpy.try_shutdown(context=self._context)

    def _wait_for_readers(self) -> None:
        """Wait a limited time until others have received what was published: a writer that ends sends nothing again."""
        end = monotonic() + RECEIVED_SECONDS
        for publisher in itertools.chain.from_iterable(node.publishers for node in self.nodes):
            with contextlib.suppress(RCLError):  # the context was shut down, or the middleware cannot tell
                publisher.wait_for_all_acked(Duration(seconds=max(end - monotonic(), 0.0)))

    def close_components(self) -> None:
        """Call the callbacks registered by :meth:`on_close`: the first part of the end."""
        with self._lock:
            callbacks, self._on_close = self._on_close, []
        self.close_all(callbacks)

    def close_all(self, callbacks: Sequence[Callable[[], object]]) -> None:
        """Call these functions, the last one first. Report exceptions and continue."""
        for callback in reversed(callbacks):
            try:
                callback()
            except Exception as error:
                where = f'closing {_called(callback)}'
                if self._thread.is_alive():
                    self.report_fault(error, where)
                    self.fail(f'{where} was not done')
                else:  # the executor thread has ended, which was reported
                    self.node.get_logger().warning(f'{where}: {error}')

    def _post_locked(self, fn: Callable[[], object]) -> None:
        is_first = not self._posted
        self._posted.append(fn)
        if is_first:
            self._doorbell.trigger()

    def _spin(self) -> None:
        end = 'it came to its end'
        try:
            self._turn()
        except ExternalShutdownException:
            end = 'the ROS context was shut down'
        except BaseException as error:  # SystemExit too
            end = ''.join(traceback.format_exception(error)).rstrip()
        with self._lock:
            if self.closed:
                return
            self._closed.set()
            for future in self._calls:
                future.cancel()
        self.abort(f'its executor thread has ended: {end}')

    def _turn(self) -> None:
        # The guard condition only ends the wait. A trigger may be lost when the wait ends for another reason, because
        # rmw_fastrtps resets the guard conditions a moment after it has checked them. So check for posted functions
        # after every wait.
        while not self._closed.is_set():
            with self._lock:
                earliest = self._timers.earliest()
            latest = self._coalesced.latest if earliest is None else min(earliest, self._coalesced.latest)
            sleep = None if latest == math.inf else max(0.0, latest - self.steady.now())
            try:
                self._executor.turn(0.0 if self._posted else sleep)
            except ExternalShutdownException:
                raise
            except Exception as error:
                if not self._context.ok():
                    raise ExternalShutdownException from error
                self._on_escaped(error)
            self.listening_time.all_handled()
            self._run_posted()
            self._run_due()
            for fn in self._coalesced.take_due(self.steady.now()):
                self._run(fn, 'a coalesced timer')

    def _run_posted(self) -> None:
        # Functions posted meanwhile wait for the next turn, so that messages and timers are not starved.
        for _ in range(len(self._posted)):
            self._run(self._posted[0], 'posted')
            # Remove it only now: while the queue is not empty, post() does not trigger the guard condition.
            with self._lock:
                self._posted.popleft()

    def _run_due(self) -> None:
        # A timer that is set meanwhile for a time that has passed waits for the next turn, as what is posted.
        now = self.steady.now()
        for _ in range(len(self._timers)):
            with self._lock:
                due = self._timers.take(now)
            if due is None:
                return
            self._run(due[1], 'a timer')

    def _run(self, fn: Callable[[], object], how: str) -> None:
        try:
            fn()
        except Exception as error:
            self.report_fault(error, f'{how} {_called(fn)}')

    def _ping(self, answer: Callable[[], None]) -> None:
        # An executor that rests is not woken, except after a stop of the process: what has come meanwhile goes first.
        before, self._pinged_at = self._pinged_at, self.steady.now()
        if self._executor.is_resting and not self._posted and self._pinged_at < before + LATE_SECONDS:
            answer()
        else:
            self.post(answer)

    def _log_hang(self, hang: Hang) -> None:
        note = '' if hang.is_over else '; meanwhile the node is late for others, and what it drives is held'
        self.node.get_logger().warning('\n'.join(filter(None, [f'{hang}{note}', hang.stack])))

    def _on_escaped(self, error: Exception) -> None:
        """Report an exception that escaped from a callback, which must not end the node."""
        if self._closed.is_set():
            return
        self.report_fault(error)
        faults = self._faults
        faults.append(time.monotonic())
        if len(faults) == _FAULTS_IN_A_ROW and faults[-1] - faults[0] < 1.0:
            time.sleep(_FAULT_PAUSE_SECONDS)  # a fault that repeats at once must not use a whole core


def _called(fn: Callable[..., object]) -> str:
    """Return what a function is called in the code."""
    return str(getattr(fn, '__qualname__', fn))


def _place_of(error: BaseException) -> tuple[str, int]:
    """Return the file and the line that raised the error."""
    trace = error.__traceback__
    while trace is not None and trace.tb_next is not None:
        trace = trace.tb_next
    return ('', 0) if trace is None else (trace.tb_frame.f_code.co_filename, trace.tb_lineno)


def qos_misfit(runtime: Runtime, topic: str) -> str:
    """Return why QoS prevents messages on a topic (resolved name); '' if no reason is known. From any thread.

    The result may be outdated if another node has ended. The call triggers a check, and a later call returns its
    result.
    """
    misfits = runtime.node.qos_misfits
    text = misfits.of(topic)
    if text:
        runtime.post(lambda: misfits.check(topic))
    return text


class _LibraryLog(logging.Handler):
    """A handler that forwards records of Python's logging, from libraries for example, to the logger of a node."""

    def __init__(self, logger: NodeLogger) -> None:
        super().__init__(logging.WARNING)
        self._logger = logger

    def emit(self, record: logging.LogRecord) -> None:
        """See :meth:`logging.Handler.emit`."""
        try:
            text = self.format(record)
        except Exception as error:  # the library's arguments do not fit its text
            text = f'{record.msg} ({error!r})'
        if record.levelno >= logging.ERROR:
            self._logger.error(f'{record.name}: {text}')
        else:
            self._logger.warning(f'{record.name}: {text}')


def run_node(
    name: str,
    setup: Callable[[NodeRuntime], object],
    args: list[str] | None = None,
    node_class: type[LargeQueueNode] = LargeQueueNode,
    about: str | None = None,
) -> int:
    """Run the node of an executable until SIGINT or SIGTERM, and return the exit code of the process.

    Call this on the main thread. ``setup`` is called on the same thread with the running runtime; it creates the
    components and registers their :meth:`NodeRuntime.on_close`. ``--help`` only prints the usage and ``about``.

    Exit codes:

    - 0 after ``--help``, or after one or more signals;
    - 1, with a line on stderr, if the node could not be set up, has failed (:meth:`NodeRuntime.fail`), cannot continue
      (:meth:`NodeRuntime.abort`), or has not ended in order;
    - 2 for arguments that are not for ROS, or are invalid.
    """
    given = sys.argv[1:] if args is None else args
    if not {'-h', '--help'}.isdisjoint(itertools.takewhile(lambda argument: argument != '--ros-args', given)):
        print(_HELP.format(name=name, about=(about or '').strip()))
        return 0
    try:
        unknown = remove_ros_args([name, *given])[1:]
    except RuntimeError as error:  # raised by rcl, for example for an invalid namespace
        print(*escape_lines(f'{name}: {error}'), sep='\n', file=sys.stderr)
        return 2
    if unknown:
        print(
            f'{name}: unknown argument {unknown[0]!r}; parameters are given by --ros-args -p NAME:=VALUE',
            file=sys.stderr,
        )
        return 2
    with HOST.entered() as (wait, wake):
        runtime: NodeRuntime | None = None
        try:
            runtime = NodeRuntime(name, args=args, node_class=node_class)
            runtime.on_failure(wake)
            handler = _LibraryLog(runtime.node.get_logger())
            logging.getLogger().addHandler(handler)
            runtime.on_close(partial(logging.getLogger().removeHandler, handler))
            setup(runtime)
            runtime.post(partial(_tell_unknown_parameters, runtime))
        except Exception as error:
            reason = (file_problem(error) if isinstance(error, OSError) else str(error)) or type(error).__name__
            print(*escape_lines(f'{name}: cannot start: {reason}'), sep='\n', file=sys.stderr, flush=True)
            if os.environ.get('FLEXBT_TRACEBACK'):
                traceback.print_exc()
            HOST.close_in_time(name, runtime)
            return 1
        wait()
        if runtime.health.failure:
            print(
                *escape_lines(f'{name}: cannot continue: {runtime.health.failure}'),
                sep='\n',
                file=sys.stderr,
                flush=True,
            )
        HOST.close_in_time(name, runtime)
        return 1 if runtime.has_failed else 0


def _tell_unknown_parameters(runtime: NodeRuntime) -> None:
    if not runtime.are_parameters_declared:
        return
    for line in unknown_parameters([one.node for one in (runtime, *runtime.further)]):
        runtime.node.get_logger().warning(line)


class Host:
    """The process of the operating system around a node: its streams, its signals, and its end."""

    def die(self) -> None:
        """End the process as a crash does."""
        os.kill(os.getpid(), signal.SIGKILL)

    @contextlib.contextmanager
    def entered(self) -> Iterator[tuple[Callable[[], object], Callable[[], object]]]:
        """Yield a function that waits for SIGINT or SIGTERM, and one that ends this wait, from any thread."""
        with StandardStreams(), _signals_as_bytes() as (signals, wake):

            def wait() -> None:
                gc.freeze()  # these objects stay; scanning them for garbage takes longer than a tick
                os.read(signals, 1)

            yield wait, wake

    def close_in_time(self, name: str, runtime: NodeRuntime | None) -> None:
        """Close the runtime. If it does not end in time, end the process."""
        if runtime is None:
            return
        in_time = threading.Timer(_CLOSE_SECONDS, _leave_now, [name, runtime])
        in_time.daemon = True
        with contextlib.suppress(RuntimeError):  # no more threads: the watchdog ends the process a second later
            in_time.start()
        # The watchdog of faulthandler ends the process even if the interpreter hangs, and reports where. It stays
        # active, because the end of the interpreter may also hang, in threads that it joins or in destructors.
        with contextlib.suppress(RuntimeError):
            faulthandler.dump_traceback_later(_CLOSE_SECONDS + 1.0, exit=True, file=watchdog_descriptor())
        gc.unfreeze()  # the default context finds its nodes through the garbage collector
        runtime.close()
        gc.freeze()  # so that the interpreter does not collect at its end: destructors of the middleware may block
        in_time.cancel()


HOST = Host()
"""The host of the nodes that :func:`run_node` runs; to be taken from this module, since tests replace it."""


@contextlib.contextmanager
def _signals_as_bytes() -> Iterator[tuple[int, Callable[[], object]]]:
    """Yield a file descriptor that receives a byte for each SIGINT and SIGTERM, and a function that writes a byte
    without a signal, from any thread. The signals have no other effect.

    The C handler writes the byte, on whatever thread the signal arrives. So a signal never interrupts Python code, no
    signal is lost during set-up, and a second signal has no effect.
    """
    reading, writing = os.pipe()
    os.set_blocking(writing, False)
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda _number, _frame: None)
    signal.set_wakeup_fd(writing, warn_on_full_buffer=False)
    try:
        yield reading, partial(os.write, writing, b'\0')
    finally:
        # The interpreter is about to end: a signal must not cause a traceback now.
        for number in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number, signal.SIG_IGN)
        signal.set_wakeup_fd(-1)
        os.close(reading)
        os.close(writing)


def _leave_now(name: str, runtime: NodeRuntime) -> None:
    if runtime.is_at_rest:  # a whole fleet: other nodes notice that the process is gone
        os._exit(1 if runtime.has_failed else 0)
    print(f'{name}: did not come to an end within {_CLOSE_SECONDS} s; leaving without', file=sys.stderr, flush=True)
    os._exit(1)
