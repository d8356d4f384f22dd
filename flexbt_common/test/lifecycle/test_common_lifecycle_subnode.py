# SPDX-License-Identifier: BSD-3-Clause
"""A part of a process that is a managed node for others, asked as a lifecycle manager does."""

from __future__ import annotations

import gc
import threading
import weakref
from functools import partial
from typing import Any

import pytest
from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState
from rcl_interfaces.msg import FloatingPointRange, ParameterDescriptor
from rclpy.parameter import Parameter
from rclpy.parameter_client import AsyncParameterClient

from flexbt_common.lifecycle.lifecycle_subnode import LifecycleSubnode
from flexbt_common.runtime.node_runtime import NodeRuntime
from flexbt_testing.nodes.clients import LifecycleClient
from flexbt_testing.waiting import DEADLINE, wait_until


def test_a_manager_takes_it_through_its_states() -> None:
    told: list[bool] = []
    with NodeRuntime.open('host', namespace='/robot1') as host, NodeRuntime.open('manager') as runtime:
        part = host.call(lambda: LifecycleSubnode(host, 'amcl', told.append))
        manager = LifecycleClient(runtime, '/robot1/amcl')
        assert manager.state() == 'active'
        assert part.is_active
        assert {label for _, label, _ in manager.transitions()} == {'deactivate', 'shutdown'}
        for transition, succeeds, state in (
            ('activate', False, 'active'),
            ('deactivate', True, 'inactive'),
            (99, False, 'inactive'),
            ('cleanup', True, 'unconfigured'),
            (1, True, 'inactive'),  # configure
            (3, True, 'active'),  # activate
            ('shutdown', True, 'finalized'),
            ('configure', False, 'finalized'),
        ):
            assert manager.change(transition) is succeeds
            assert manager.state() == state
        assert told == [False, True, False]
        assert not part.is_active


def test_a_transition_that_comes_while_it_is_closed_is_not_told() -> None:
    """Otherwise a part that was closed would begin to work again."""
    told: list[bool] = []
    may_close = threading.Event()
    with NodeRuntime.open('host') as host, NodeRuntime.open('manager') as runtime:
        part = host.call(lambda: LifecycleSubnode(host, 'amcl', told.append))
        client = runtime.call(lambda: runtime.node.create_client(ChangeState, '/amcl/change_state'))
        wait_until(lambda: runtime.call(client.service_is_ready), 'the part')
        host.post(may_close.wait)
        host.post(part.close)
        request = ChangeState.Request(transition=Transition(id=Transition.TRANSITION_DEACTIVATE))
        runtime.call(lambda: client.call_async(request))
        wait_until(lambda: not part.is_active, 'the transition')
        may_close.set()
        host.call(lambda: None)
    assert not told


def test_it_is_a_node_as_long_as_it_is_there() -> None:
    with NodeRuntime.open('host', namespace='/robot1') as host, NodeRuntime.open('manager') as runtime:

        def names_and_namespaces() -> set[tuple[str, str]]:
            return set(runtime.node.get_node_names_and_namespaces())

        part = host.call(lambda: LifecycleSubnode(host, 'deeper/amcl'))
        wait_until(lambda: ('amcl', '/robot1/deeper') in names_and_namespaces(), names_and_namespaces)

        def services() -> list[tuple[str, list[str]]]:
            found: list[tuple[str, list[str]]] = runtime.node.get_service_names_and_types_by_node(
                'amcl', '/robot1/deeper'
            )
            return found

        wait_until(lambda: ('/robot1/deeper/amcl/get_state', ['lifecycle_msgs/srv/GetState']) in services(), services)
        assert LifecycleClient(runtime, '/robot1/deeper/amcl').state() == 'active'
        host.call(part.close)
        wait_until(lambda: ('amcl', '/robot1/deeper') not in names_and_namespaces(), names_and_namespaces)
        assert ('host', '/robot1') in names_and_namespaces()
        host.call(lambda: LifecycleSubnode(host, 'amcl'))
        wait_until(lambda: ('amcl', '/robot1') in names_and_namespaces(), names_and_namespaces)
        host.close()
        wait_until(lambda: not {name for name, _ in names_and_namespaces()} & {'host', 'amcl'}, names_and_namespaces)


@pytest.mark.parametrize('closed', [0, 1])
def test_what_a_part_has_told_is_freed_when_it_is_closed(closed: int) -> None:
    class Owner:
        def tell(self, _is_active: bool) -> None:
            pass

    with NodeRuntime.open('host') as host, NodeRuntime.open('manager') as runtime:
        owners = [Owner(), Owner()]
        parts = [host.call(lambda n=n: LifecycleSubnode(host, f'part{n}', owners[n].tell)) for n in range(2)]  # type: ignore[misc]
        assert LifecycleClient(runtime, f'part{1 - closed}').state() == 'active'
        told = weakref.ref(owners.pop(closed))
        host.call(parts.pop(closed).close)
        wait_until(lambda: gc.collect() >= 0 and told() is None, 'it is freed', every=0.25)
        assert LifecycleClient(runtime, f'part{1 - closed}').state() == 'active'


def test_its_parameters_can_be_set_at_any_time_as_those_of_any_node() -> None:
    told: list[tuple[float, bool]] = []
    with NodeRuntime.open('host', namespace='/robot1') as host, NodeRuntime.open('person') as person:
        part = host.call(lambda: LifecycleSubnode(host, 'controller_server', has_parameters=True))
        bounds = ParameterDescriptor(floating_point_range=[FloatingPointRange(from_value=0.1, to_value=1.0)])
        host.call(
            lambda: part.declare('FollowPath.speed', 0.3, bounds, lambda v: told.append((v, host.on_executor_thread)))
        )
        client = person.call(lambda: AsyncParameterClient(person.node, '/robot1/controller_server'))  # as ros2 param's
        assert client.wait_for_services(DEADLINE)

        def answer(ask: Any) -> Any:
            future, done = person.call(ask), threading.Event()
            person.call(lambda: future.add_done_callback(lambda _: done.set()))
            assert done.wait(DEADLINE)
            return future.result()

        assert 'FollowPath.speed' in answer(client.list_parameters).result.names
        for value, successful in ((0.2, True), (7.0, False), ('fast', False)):
            wanted = Parameter('FollowPath.speed', value=value)
            (result,) = answer(lambda wanted=wanted: client.set_parameters([wanted])).results
            assert result.successful is successful, result.reason
            assert answer(lambda: client.get_parameters(['FollowPath.speed'])).values[0].double_value == 0.2
        (result,) = answer(lambda: client.set_parameters([Parameter('FollowPath.lookahead', value=1.0)])).results
        assert not result.successful
        (result,) = answer(lambda: client.set_parameters([Parameter('use_sim_time', value=True)])).results
        assert not result.successful and 'set use_sim_time of /robot1/host' in result.reason
        assert told == [(0.2, True)]


def test_it_says_that_it_has_the_time_of_its_process() -> None:
    with NodeRuntime.open('host', parameters={'use_sim_time': True}) as host, NodeRuntime.open('person') as person:
        part = host.call(lambda: LifecycleSubnode(host, 'planner_server', has_parameters=True))
        client = person.call(lambda: AsyncParameterClient(person.node, '/planner_server'))
        assert client.wait_for_services(DEADLINE)

        def told() -> bool:
            future, done = person.call(lambda: client.get_parameters(['use_sim_time'])), threading.Event()
            person.call(lambda: future.add_done_callback(lambda _: done.set()))
            assert done.wait(DEADLINE)
            return bool(future.result().values[0].bool_value)

        assert told()
        for value in (False, True):
            (result,) = host.call(partial(host.node.set_parameters, [Parameter('use_sim_time', value=value)]))
            assert result.successful, result.reason
            assert told() is value
        assert person.node.count_subscribers('/clock') == 1  # that of the host
        host.call(part.close)
        (result,) = host.call(lambda: host.node.set_parameters([Parameter('use_sim_time', value=False)]))
        assert result.successful, result.reason
