# SPDX-License-Identifier: BSD-3-Clause
"""Observations of the ROS graph: nodes, servers, topics with their qualities of service, and parameters of nodes."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Iterable, Iterator
from concurrent.futures import Future
from dataclasses import dataclass, field
from typing import Any, Final

from rcl_interfaces.srv import GetParameters
from rclpy.action.graph import get_action_names_and_types
from rclpy.parameter import parameter_value_to_python

from flexbt_common.calls.service_call import ServiceCall, ServiceLinks, ServiceOutcome
from flexbt_common.middleware.qos_misfits import why_misfit
from flexbt_common.names import node_of
from flexbt_common.runtime.node_runtime import NodeRuntime

_STILL: Final = 3.5
"""Time without anything new after which the graph counts as known, s of wall time. Fast DDS announces a process again
every 3 s: whoever missed the first announcements, as on a busy computer, hears of it then."""


@dataclass(frozen=True)
class Graph:
    """The graph at one moment. Names are absolute."""

    nodes: tuple[str, ...]
    """Names of the other nodes, sorted; a name that two nodes have stands there twice."""
    actions: dict[str, tuple[str, ...]]
    """Types by the name of the action; only of those that have a server, as for services: clients alone show, too."""
    services: dict[str, tuple[str, ...]]
    topics: dict[str, tuple[str, ...]]
    publishers: dict[str, list[Any]] = field(repr=False, default_factory=dict)
    """Endpoints by topic, as rclpy describes them."""
    subscriptions: dict[str, list[Any]] = field(repr=False, default_factory=dict)

    @property
    def duplicates(self) -> list[str]:
        """Names that several nodes have."""
        return [name for name, count in Counter(self.nodes).items() if count > 1]

    def is_published(self, topic: str) -> bool:
        return bool(self.publishers.get(topic))

    def misfits(self) -> Iterator[tuple[str, str, str, str]]:
        """Yield topic, publisher, subscriber and reason where two nodes cannot exchange messages."""
        for topic, publishers in self.publishers.items():
            for publisher in publishers:
                for subscription in self.subscriptions.get(topic, ()):
                    sender, receiver = node_of(publisher), node_of(subscription)
                    reason = why_misfit(publisher.qos_profile, subscription.qos_profile, sender, receiver)
                    if reason:
                        yield topic, sender, receiver, reason


def observe(runtime: NodeRuntime, seconds: float) -> Graph:
    """Return the graph when nothing new has appeared for a while, at the latest after this time, s of wall time."""
    end = time.monotonic() + seconds
    known: tuple[list[str], ...] = ()
    still_since = time.monotonic()
    while time.monotonic() < end:
        found = runtime.call(lambda: _names(runtime))
        if found != known:
            known, still_since = found, time.monotonic()
        elif known[0] and time.monotonic() - still_since >= _STILL:
            break
        time.sleep(0.05)  # the graph has no event that tells that nothing more comes
    return runtime.call(lambda: _graph(runtime))


def _names(runtime: NodeRuntime) -> tuple[list[str], ...]:
    """Return the names of nodes, topics and services."""
    node = runtime.node
    topics = sorted(name for name, _ in node.get_topic_names_and_types())
    return node_names(runtime), topics, sorted(name for name, _ in node.get_service_names_and_types())


def node_names(runtime: NodeRuntime) -> list[str]:
    """Return the full names of all other nodes. On the executor thread."""
    me = runtime.node.get_fully_qualified_name()
    found = [f'{namespace.rstrip("/")}/{name}' for name, namespace in runtime.node.get_node_names_and_namespaces()]
    if me in found:
        found.remove(me)
    return sorted(name for name in found if not name.rpartition('/')[2].startswith('_'))


def _graph(runtime: NodeRuntime) -> Graph:
    node = runtime.node
    me = node.get_fully_qualified_name()

    def others(endpoints: Iterable[Any]) -> list[Any]:
        return [endpoint for endpoint in endpoints if node_of(endpoint) != me]

    def served(found: list[tuple[str, list[str]]], service: str = '') -> dict[str, tuple[str, ...]]:
        return {name: tuple(types) for name, types in found if node.count_services(name + service)}

    topics = {name: tuple(types) for name, types in node.get_topic_names_and_types()}
    return Graph(
        tuple(node_names(runtime)),
        served(get_action_names_and_types(node), '/_action/send_goal'),
        served(node.get_service_names_and_types()),
        topics,
        {topic: others(node.get_publishers_info_by_topic(topic)) for topic in topics},
        {topic: others(node.get_subscriptions_info_by_topic(topic)) for topic in topics},
    )


def parameters(runtime: NodeRuntime, nodes: Iterable[str], name: str, timeout: float) -> dict[str, Any]:
    """Return the values of a parameter by node, None if it does not have it; nodes that do not answer are missing."""
    links = runtime.call(lambda: ServiceLinks(runtime))
    answers: dict[str, Future[ServiceOutcome]] = {}
    for node in nodes:
        answer: Future[ServiceOutcome] = Future()
        answers[node] = answer
        ServiceCall(
            links.link(GetParameters, f'{node}/get_parameters'),
            GetParameters.Request(names=[name]),
            on_done=answer.set_result,
            server_timeout=timeout,
            response_timeout=timeout,
        )
    found = {}
    for node, answer in answers.items():
        response = answer.result(2.0 * timeout + 1.0).response
        if response is not None:
            found[node] = next(map(parameter_value_to_python, response.values), None)
    return found
