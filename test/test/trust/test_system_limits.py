# SPDX-License-Identifier: BSD-3-Clause
"""Far too much in each field of everything that the processes of a robot receive: refused in words, and they go on."""

from __future__ import annotations

import importlib
import re
import resource
import subprocess
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import Any

import pytest
from rclpy.action import get_action_server_names_and_types_by_node
from rclpy.duration import Duration
from rclpy.qos import LivelinessPolicy, QoSProfile

from flexbt_common import names
from flexbt_common.calls.action_call import ActionLinks, GoalStatus
from flexbt_common.calls.service_call import ServiceLinks, service_outcome
from flexbt_common.errors import LimitExceededError
from flexbt_common.lifecycle.liveliness import LEASE_SECONDS
from flexbt_common.runtime.node_runtime import NodeRuntime
from flexbt_common.values.limits import check_limits
from flexbt_testing.nodes.clients import SentGoal
from flexbt_testing.nodes.oversized import oversized
from flexbt_testing.system.probe import Probe
from flexbt_testing.system.processes import Stack, executable
from flexbt_testing.waiting import DEADLINE, wait_until

MEMORY = 450
"""MB of a process at most. At rest it has some 150, and 210 after all of this: the middleware keeps room for the
largest message that each service and topic has had, and navigation has fifty of them."""

MUCH, MANY = 2_000_000, 2_100
"""Bytes and elements that are too much for most fields of goals and requests."""

SERVERS = (names.NAVIGATION, names.BT_SERVER, names.ONBOARD_EXECUTIVE)
NODES = (names.SIMULATOR, *SERVERS, names.STOP_GUARD)
CUTS_OFF = frozenset(
    f'/{topic}'
    for topic in (
        names.EXECUTIVE_COMMAND,
        names.EXECUTIVE_STOP,
        names.EXECUTIVE_PRESENCE,
        names.EXECUTIVE_PING,
        names.EXECUTIVE_STATUS,
        names.TREE_DEBUGGING,
        *map(names.alive_topic, NODES),
    )
)
"""Topics whose flooders are cut off by the middleware."""


@pytest.mark.parametrize('name', ['simulation', *NODES])
def test_a_node_that_may_have_too_little_address_space_ends_with_a_sentence(name: str) -> None:
    limit = 800_000_000
    done = subprocess.run(
        [executable(name)],
        capture_output=True,
        text=True,
        timeout=DEADLINE,
        check=False,
        preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_AS, (limit, limit)),
    )
    assert done.returncode == 1 and done.stderr.count('\n') == 1, done
    assert done.stderr.startswith(f'{name}: the limit of address space is 800 MB (ulimit -v)'), done.stderr


@pytest.fixture(scope='module')
def stack(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Stack]:
    with Stack(tmp_path_factory.mktemp('robot')) as stack:
        stack.start_all()
        yield stack


@pytest.fixture(scope='module')
def runtime() -> Iterator[NodeRuntime]:
    with NodeRuntime.open('client') as runtime:
        yield runtime


@pytest.fixture(scope='module')
def probe(stack: Stack, runtime: NodeRuntime) -> Probe:
    probe = Probe(runtime)
    probe.wait_ready()
    return probe


def _class_of(type_name: str) -> Any:
    package, kind, name = type_name.split('/')
    return getattr(importlib.import_module(f'{package}.{kind}'), name)


def memory(stack: Stack, name: str) -> int:
    """Return the most memory that a process has had, MB."""
    status = Path(f'/proc/{stack._processes[name].pid}/status').read_text()
    found = re.search(r'VmHWM:\s+(\d+) kB', status)
    assert found is not None
    return int(found[1]) // 1024


def quality(topic: str) -> QoSProfile:
    """With which everybody hears a topic."""
    profile = names.transient_local_qos()
    if topic.endswith('/alive'):
        profile.liveliness = LivelinessPolicy.MANUAL_BY_TOPIC
        profile.liveliness_lease_duration = Duration(seconds=LEASE_SECONDS)
    return profile


def refused(message_type: type[Any]) -> Iterator[tuple[str, Any]]:
    """As `oversized`, with no more in each field than is needed: the middleware, and Python, work for each byte."""
    for path, message in oversized(message_type, MUCH, MANY):
        try:
            check_limits(message)
        except LimitExceededError:
            yield path, message
        else:
            yield next((there, larger) for there, larger in oversized(message_type) if there == path)


@pytest.fixture(autouse=True)
def bounded(stack: Stack, probe: Probe) -> Iterator[None]:
    """Whatever a test does, all processes go on, and their memory is bounded."""
    yield
    for name in stack.running():
        assert memory(stack, name) < MEMORY, name
    assert stack.running() == set(NODES)
    seen = len(probe.statuses)
    probe.wait(lambda: len(probe.statuses) > seen, 'a status of the executive')


@pytest.mark.parametrize('server', SERVERS)
def test_goals_with_too_much_in_a_field_are_refused_by_its_name(runtime: NodeRuntime, server: str) -> None:
    links = ActionLinks(runtime, DEADLINE)  # to unpack 10 MB takes a busy machine its time
    served = runtime.call(lambda: get_action_server_names_and_types_by_node(runtime.node, server, '/'))
    assert served
    for action, (type_name,) in served:
        action_type = _class_of(type_name)
        for path, goal in refused(action_type.Goal):
            sent = SentGoal(links.link(action_type, action), goal, DEADLINE)
            assert sent.wait().status is GoalStatus.ABORTED, path
            texts = [getattr(sent.result, name) for name in ('message', 'error_msg') if hasattr(sent.result, name)]
            if texts:  # not every result of Nav2 has room for one
                text = ''.join(texts)
                assert f'{path} has' in text and 'at most' in text, (path, text)
                assert len(text) < 1000


@pytest.mark.parametrize('server', NODES)
def test_requests_with_too_much_in_a_field_are_answered(runtime: NodeRuntime, server: str) -> None:
    links = ServiceLinks(runtime, DEADLINE)
    served = runtime.call(lambda: runtime.node.get_service_names_and_types_by_node(server, '/'))
    for service, (type_name,) in served:
        of_rclpy = service.startswith(f'/{server}/') and type_name.startswith(('rcl_interfaces/', 'type_description_'))
        if '/_action/' in service or (of_rclpy and server != names.ONBOARD_EXECUTIVE):  # the same in each node
            continue
        service_type = _class_of(type_name)
        for path, request in refused(service_type.Request):
            outcome = service_outcome(links.link(service_type, service), request, DEADLINE)
            assert outcome.ok, (service, path, outcome.reason)


def test_messages_with_too_much_in_a_field_are_left_aside(runtime: NodeRuntime) -> None:
    """Each is sent once, to all nodes that hear its topic."""

    def heard(node: str) -> list[tuple[str, list[str]]]:
        return runtime.node.get_subscriber_names_and_types_by_node(node, '/')

    topics = {topic: types for node in NODES for topic, types in runtime.call(partial(heard, node))}
    for topic, (type_name,) in topics.items():
        if '/_action/' not in topic:
            _send_oversized(topic, _class_of(type_name), runtime.call(partial(runtime.node.count_subscribers, topic)))


def _send_oversized(topic: str, message_type: Any, subscribers: int) -> None:
    messages = [message for _, message in oversized(message_type)]
    if not messages:
        return
    with NodeRuntime.open('flooder') as flooder:  # who floods the operator link is not heard any more
        publisher = flooder.call(lambda: flooder.node.create_publisher(message_type, topic, quality(topic)))
        wait_until(lambda: publisher.get_subscription_count() >= subscribers, f'{subscribers} subscribers of {topic}')
        for message in messages:
            publisher.publish(message)
            assert topic in CUTS_OFF or publisher.wait_for_all_acked(Duration(seconds=DEADLINE))
