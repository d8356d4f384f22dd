# SPDX-License-Identifier: BSD-3-Clause
"""The module that stands in for ``rclpy._rclpy_pybind11``: everything above it is the installed rclpy."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from types import ModuleType
from typing import Any, Final
from weakref import WeakKeyDictionary

from . import clocks, graph, services, topics
from .boundary import BOUNDARY
from .graph import DOMAIN, MODULE, REAL, Context, Destroyable, type_name
from .scheduler import BOOT, SCHEDULER, SECOND, Process

IDENTIFIER: Final = 'one_process'
"""Name of the middleware of a world."""

ROS_TIME: Final = REAL.ClockType.ROS_TIME


class Node(graph.Node):
    """Stand-in for rcl's node, whose log goes to /rosout."""

    def __init__(
        self,
        name: str,
        namespace: str,
        context: Context,
        cli_args: Sequence[str] | None,
        use_global_arguments: bool,
        enable_rosout: bool,
        rosout_qos: Any = None,  # since Kilted
    ) -> None:
        super().__init__(name, namespace, context, cli_args, use_global_arguments)
        if enable_rosout and context.rules.has_rosout:
            from rcl_interfaces.msg import Log
            from rclpy.duration import Duration
            from rclpy.qos import DurabilityPolicy, QoSProfile

            profile = QoSProfile(depth=1000, durability=DurabilityPolicy.TRANSIENT_LOCAL, lifespan=Duration(seconds=10))
            self.rosout = topics.Publisher(self, Log, '/rosout', rosout_qos or profile.get_c_qos_profile())


_CLASSES: Final[tuple[type, ...]] = (
    Context,
    Destroyable,
    Node,
    clocks.Clock,
    clocks.ClockEvent,
    clocks.GuardCondition,
    clocks.Timer,
    clocks.WaitSet,
    services.ActionClient,
    services.ActionGoalHandle,
    services.ActionServer,
    services.Client,
    services.LifecycleStateMachine,
    services.Service,
    services.TypeDescriptionService,
    services.rmw_request_id_t,
    services.rmw_service_info_t,
    topics.EventHandle,
    topics.Publisher,
    topics.Subscription,
)
NamesAndTypes = list[tuple[str, list[str]]]


def _names_and_types(ends: list[Any], attribute: str) -> NamesAndTypes:
    names: dict[str, set[str]] = {}
    for end in ends:
        names.setdefault(getattr(end, attribute), set()).add(type_name(end.type))
    return [(name, sorted(types)) for name, types in sorted(names.items())]


def _topics(node: Node, _no_demangle: bool) -> NamesAndTypes:
    node.context.check('failed to get topic names and types')
    return _names_and_types(node.ends(DOMAIN.topics, 'publishers', 'subscriptions'), 'name')


def _services(node: Node) -> NamesAndTypes:
    node.context.check('failed to get service names and types')
    return _names_and_types(node.ends(DOMAIN.services, 'servers', 'clients'), 'service')


def _of_node(table: Any, side: str, attribute: str) -> Callable[..., NamesAndTypes]:
    def names_and_types(node: Node, *rest: Any) -> NamesAndTypes:
        node.context.check('failed to get names and types')
        wanted = tuple(rest[-2:])
        if wanted not in node.get_node_names_and_namespaces():
            raise REAL.NodeNameNonExistentError(f'cannot get names and types: unknown node {wanted[0]!r}')
        ends = [end for end in node.ends(table(), side) if (end.node.name, end.node.namespace) == wanted]
        return _names_and_types(ends, attribute)

    return names_and_types


def _endpoints(side: str, number: int) -> Callable[[Node, str, bool], list[dict[str, Any]]]:
    def infos(node: Node, name: str, no_mangle: bool) -> list[dict[str, Any]]:
        node.context.check('Failed to get information by topic')
        topics_of = _dds_topics if no_mangle else _ros_topics
        return [
            {
                'node_name': end.node.name,
                'node_namespace': end.node.namespace,
                'topic_type': kind,
                'topic_type_hash': {'version': 1, 'value': bytes(32)},
                'endpoint_type': number,
                'endpoint_gid': list(end.gid),
                'qos_profile': _told_qos(given),
            }
            for end, kind, given in topics_of(node, side, name)
        ]

    return infos


_Ends = Iterator[tuple[Any, str, dict[str, Any]]]
_SERVICE_TOPICS: Final = {
    ('rq', 'publishers'): ('Request', '_Request', 'clients'),
    ('rq', 'subscriptions'): ('Request', '_Request', 'servers'),
    ('rr', 'publishers'): ('Reply', '_Response', 'servers'),
    ('rr', 'subscriptions'): ('Reply', '_Response', 'clients'),
}
"""By prefix of the DDS topic, and side: the endings of its name and type, and the side of the service."""


def _ros_topics(node: Node, side: str, name: str) -> _Ends:
    for end in node.ends(DOMAIN.topics, side, name=name):
        yield end, type_name(end.type), end.qos.given


def _dds_topics(node: Node, side: str, name: str) -> _Ends:
    """Yield the endpoints of a topic by its name in DDS, where each service has two (see the ROS 2 design article
    "Topic and Service name mapping to DDS")."""
    prefix, _, path = name.partition('/')
    if prefix == 'rt':
        for end, kind, given in _ros_topics(node, side, f'/{path}'):
            yield end, _dds_type(kind), given
    elif (prefix, side) in _SERVICE_TOPICS:
        ending, part, of_service = _SERVICE_TOPICS[prefix, side]
        service = f'/{path}'.removesuffix(ending) if path.endswith(ending) else ''
        for end in node.ends(DOMAIN.services, of_service, name=service) if service else ():
            yield end, _dds_type(type_name(end.type) + part), end.given


def _dds_type(kind: str) -> str:
    package, folder, name = kind.split('/')
    return f'{package}::{folder}::dds_::{name}_'


def _told_qos(given: dict[str, Any]) -> dict[str, Any]:
    """Return the QoS of an endpoint as the graph tells it: without its queue, and with what is meant by defaults."""
    from rclpy.duration import Infinite
    from rclpy.qos import HistoryPolicy, LivelinessPolicy

    meant = {name: Infinite for name, value in given.items() if getattr(value, 'nanoseconds', None) == 0}
    if given['liveliness'] == LivelinessPolicy.SYSTEM_DEFAULT:
        meant['liveliness'] = LivelinessPolicy.AUTOMATIC
    return {**given, **meant, 'history': HistoryPolicy.UNKNOWN, 'depth': 0}


def _node_of_logger(process: Process, name: str) -> graph.Node | None:
    """Return the node on whose topic a logger writes: that of its name, or whose child it is."""
    name = DOMAIN.parents.get((process, name), name)
    own = (one for one in DOMAIN.nodes if one.process is process and one.rosout is not None)
    return next((one for one in own if one.logger_name() == name), None)


def _add_sublogger(logger: str, sublogger: str) -> bool:
    process = SCHEDULER.current.process
    node = _node_of_logger(process, logger)
    if node is not None:
        DOMAIN.parents[process, f'{logger}.{sublogger}'] = node.logger_name()
    return node is not None


def _log(severity: Any, name: str, text: str, *where: Any) -> None:
    if SCHEDULER.current.process is SCHEDULER.main.process:  # of the test, which may look at its streams
        REAL.rclpy_logging_rcutils_log(severity, name, text, *where)
    DOMAIN.log.append((SCHEDULER.now, SCHEDULER.current.process, int(severity), name, text))
    process = SCHEDULER.current.process
    node = _node_of_logger(process, name)
    if node is not None and node.context.ok():
        from builtin_interfaces.msg import Time
        from rcl_interfaces.msg import Log

        stamp = Time(sec=SCHEDULER.wall // SECOND, nanosec=SCHEDULER.wall % SECOND)
        function, file, line = where
        node.rosout.publish(
            Log(stamp=stamp, level=int(severity), name=name, msg=text, file=file, function=function, line=line)
        )
    if process.log is not None or os.environ.get('FLEXBT_ONE_PROCESS_LOG'):
        level = REAL.RCUTILS_LOG_SEVERITY(int(severity)).name.removeprefix('RCUTILS_LOG_SEVERITY_')
        (process.log or sys.stderr).write(f'[{level}] [{(SCHEDULER.now - BOOT) / SECOND:.6f}] [{name}]: {text}\n')


def _set_level(logger: str, *how: Any) -> Any:
    if BOUNDARY.is_inside:
        DOMAIN.levels.setdefault(logger, REAL.rclpy_logging_get_logger_level(logger))
    return REAL.rclpy_logging_set_logger_level(logger, *how)


def _resolve_name(node: Node, name: str, only_expand: bool, is_service: bool) -> str:
    try:
        return node.expanded(name) if only_expand else node.resolved(name, 'service' if is_service else 'topic')
    except ValueError as error:
        raise graph.RCLError(f'failed to resolve name: {error}') from None


class _Signals:
    """Handling of SIGTERM by rclpy in a process: contexts are shut down, and executors are woken."""

    def __init__(self) -> None:
        self._guards: WeakKeyDictionary[clocks.GuardCondition, Process] = WeakKeyDictionary()
        self._before: WeakKeyDictionary[Process, Callable[[], object] | None] = WeakKeyDictionary()
        """The handlers that rclpy has replaced."""

    def install(self, options: Any = REAL.SignalHandlerOptions.ALL) -> None:
        process = SCHEDULER.current.process
        is_meant = options in (REAL.SignalHandlerOptions.ALL, REAL.SignalHandlerOptions.SIGTERM)
        if is_meant and process is not SCHEDULER.main.process and process not in self._before:
            self._before[process] = process.signal
            process.signal = partial(self._end, process)

    def uninstall(self) -> None:
        process = SCHEDULER.current.process
        if process in self._before:
            process.signal = self._before.pop(process)

    def current(self) -> Any:
        is_installed = SCHEDULER.current.process in self._before
        return REAL.SignalHandlerOptions.ALL if is_installed else REAL.SignalHandlerOptions.NO

    def register(self, guard: clocks.GuardCondition) -> None:
        self._guards[guard] = SCHEDULER.current.process

    def unregister(self, guard: clocks.GuardCondition) -> None:
        self._guards.pop(guard, None)

    def _end(self, process: Process) -> None:
        for context in process.contexts:
            if context.ok():
                context.shutdown()
        for guard in [guard for guard, owner in self._guards.items() if owner is process]:
            guard.trigger_guard_condition()
        if before := self._before[process]:
            before()


def _events_executor(context: Any) -> Any:
    """Return an executor that does what the experimental one in C++ is for, on one thread."""
    from rclpy.executors import SingleThreadedExecutor

    return SingleThreadedExecutor(context=context)


_SIGNALS: Final = _Signals()
_FUNCTIONS: Final[dict[str, Any]] = {
    'EventsExecutor': _events_executor,
    'install_signal_handlers': _SIGNALS.install,
    'uninstall_signal_handlers': _SIGNALS.uninstall,
    'get_current_signal_handlers_options': _SIGNALS.current,
    'register_sigint_guard_condition': _SIGNALS.register,
    'unregister_sigint_guard_condition': _SIGNALS.unregister,
    'rclpy_assert_liveliness': lambda publisher: publisher.assert_liveliness(),
    'rclpy_get_rmw_implementation_identifier': lambda: IDENTIFIER,
    'rclpy_get_client_names_and_types_by_node': _of_node(lambda: DOMAIN.services, 'clients', 'service'),
    'rclpy_get_service_names_and_types_by_node': _of_node(lambda: DOMAIN.services, 'servers', 'service'),
    'rclpy_get_publisher_names_and_types_by_node': _of_node(lambda: DOMAIN.topics, 'publishers', 'name'),
    'rclpy_get_subscriber_names_and_types_by_node': _of_node(lambda: DOMAIN.topics, 'subscriptions', 'name'),
    'rclpy_get_publishers_info_by_topic': _endpoints('publishers', 1),
    'rclpy_get_subscriptions_info_by_topic': _endpoints('subscriptions', 2),
    'rclpy_get_service_names_and_types': _services,
    'rclpy_get_topic_names_and_types': _topics,
    'rclpy_logging_configure': lambda _context: None,
    'rclpy_logging_fini': lambda: None,
    'rclpy_logging_rcutils_log': _log,
    'rclpy_logging_set_logger_level': _set_level,
    'rclpy_logging_rosout_add_sublogger': _add_sublogger,
    'rclpy_logging_rosout_remove_sublogger': lambda _logger, _sublogger: None,
    'rclpy_remap_topic_name': lambda node, name: node.resolved(name),
    'rclpy_resolve_name': _resolve_name,
}


def is_installed() -> bool:
    """Return whether rclpy has the substitute."""
    return getattr(sys.modules.get(MODULE), 'REAL', None) is REAL


def install() -> None:
    """Let rclpy find the substitute. Call it before rclpy is imported."""
    module = ModuleType(MODULE)
    module.__dict__.update({name: getattr(REAL, name) for name in dir(REAL) if not name.startswith('__')})
    module.__dict__.update({one.__name__: one for one in _CLASSES}, **_FUNCTIONS, REAL=REAL)
    sys.modules[MODULE] = module
