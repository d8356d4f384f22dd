# SPDX-License-Identifier: BSD-3-Clause
"""The module that stands in for ``rclpy._rclpy_pybind11``: everything above it is the installed rclpy."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable
from types import ModuleType
from typing import Any, Final

from . import clocks, services, topics
from .graph import DOMAIN, MODULE, REAL, Context, Destroyable, Node, type_name
from .scheduler import BOOT, SCHEDULER, SECOND

IDENTIFIER: Final = 'one_process'
"""Name of the middleware of a world."""

ROS_TIME: Final = REAL.ClockType.ROS_TIME

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


def _names_and_types(pairs: list[tuple[str, Any]]) -> NamesAndTypes:
    names: dict[str, set[str]] = {}
    for name, kind in pairs:
        names.setdefault(name, set()).add(type_name(kind))
    return [(name, sorted(types)) for name, types in sorted(names.items())]


def _is_of(name: str, namespace: str) -> Callable[[Any], bool]:
    if not any((node.name, node.namespace) == (name, namespace) for node in DOMAIN.nodes):
        raise REAL.NodeNameNonExistentError(f'cannot get topic names and types: unknown node {name!r} in {namespace!r}')
    return lambda end: (end.node.name, end.node.namespace) == (name, namespace)


def _topic_ends(side: str, is_meant: Callable[[Any], bool] = lambda _: True) -> NamesAndTypes:
    ends = (end for topic in DOMAIN.topics.values() for end in getattr(topic, side))
    return _names_and_types([(end.name, end.type) for end in ends if is_meant(end)])


def _service_ends(side: str, is_meant: Callable[[Any], bool] = lambda _: True) -> NamesAndTypes:
    ends = (end for service in DOMAIN.services.values() for end in getattr(service, side))
    return _names_and_types([(end.service, end.type) for end in ends if is_meant(end)])


def _topics(_node: Node, _no_demangle: bool) -> NamesAndTypes:
    ends = [end for topic in DOMAIN.topics.values() for end in (*topic.publishers, *topic.subscriptions)]
    return _names_and_types([(end.name, end.type) for end in ends])


def _endpoints(side: str, number: int) -> Callable[[Node, str, bool], list[dict[str, Any]]]:
    def infos(_node: Node, name: str, _no_mangle: bool) -> list[dict[str, Any]]:
        ends = getattr(DOMAIN.topics[name], side) if name in DOMAIN.topics else ()
        return [
            {
                'node_name': end.node.name,
                'node_namespace': end.node.namespace,
                'topic_type': type_name(end.type),
                'topic_type_hash': {'version': 1, 'value': bytes(32)},
                'endpoint_type': number,
                'endpoint_gid': list(end.gid),
                'qos_profile': dict(end.qos.given),
            }
            for end in ends
        ]

    return infos


def _log(severity: Any, name: str, text: str, *_where: Any) -> None:
    DOMAIN.log.append((SCHEDULER.now, SCHEDULER.current.process, int(severity), name, text))
    if os.environ.get('FLEXBT_ONE_PROCESS_LOG'):
        level = REAL.RCUTILS_LOG_SEVERITY(int(severity)).name.removeprefix('RCUTILS_LOG_SEVERITY_')
        sys.stderr.write(f'[{level}] [{(SCHEDULER.now - BOOT) / SECOND:.6f}] [{name}]: {text}\n')


_FUNCTIONS: Final[dict[str, Any]] = {
    'install_signal_handlers': lambda _options=None: None,
    'uninstall_signal_handlers': lambda: None,
    'register_sigint_guard_condition': lambda _guard: None,
    'unregister_sigint_guard_condition': lambda _guard: None,
    'rclpy_assert_liveliness': lambda publisher: publisher.assert_liveliness(),
    'rclpy_get_rmw_implementation_identifier': lambda: IDENTIFIER,
    'rclpy_get_client_names_and_types_by_node': lambda _, name, space: _service_ends('clients', _is_of(name, space)),
    'rclpy_get_service_names_and_types_by_node': lambda _, name, space: _service_ends('servers', _is_of(name, space)),
    'rclpy_get_publisher_names_and_types_by_node': lambda _, _raw, name, space: _topic_ends(
        'publishers', _is_of(name, space)
    ),
    'rclpy_get_subscriber_names_and_types_by_node': lambda _, _raw, name, space: _topic_ends(
        'subscriptions', _is_of(name, space)
    ),
    'rclpy_get_publishers_info_by_topic': _endpoints('publishers', 1),
    'rclpy_get_subscriptions_info_by_topic': _endpoints('subscriptions', 2),
    'rclpy_get_service_names_and_types': lambda _node: _service_ends('servers'),
    'rclpy_get_topic_names_and_types': _topics,
    'rclpy_logging_configure': lambda _context: None,
    'rclpy_logging_fini': lambda: None,
    'rclpy_logging_rcutils_log': _log,
    'rclpy_logging_rosout_add_sublogger': lambda _logger, _sublogger: False,
    'rclpy_logging_rosout_remove_sublogger': lambda _logger, _sublogger: None,
    'rclpy_remap_topic_name': lambda node, name: node.resolved(name),
    'rclpy_resolve_name': lambda node, name, only_expand, _is_service: (
        node.expanded(name) if only_expand else node.resolved(name)
    ),
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
