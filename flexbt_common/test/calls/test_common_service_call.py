# SPDX-License-Identifier: BSD-3-Clause
"""Service calls against real services."""

from __future__ import annotations

import contextlib
import queue
import signal
import threading
import weakref
from collections.abc import Iterator
from typing import Any

import numpy
import pytest
from action_msgs.srv import CancelGoal
from nav2_msgs.action import Wait
from std_srvs.srv import SetBool, Trigger

from flexbt_common.calls import links as links_module
from flexbt_common.calls.action_call import ActionCall, ActionLinks, GoalStatus
from flexbt_common.calls.service_call import ServiceCall, ServiceLink, ServiceLinks, ServiceOutcome, service_outcome
from flexbt_common.lifecycle.liveliness import LivelinessToken, LivelinessWatch
from flexbt_common.lifecycle.managed_node import NodeScope
from flexbt_common.runtime.node_runtime import NodeRuntime
from flexbt_testing.system.python_processes import PythonProcess, python_process
from flexbt_testing.waiting import DEADLINE, wait_until

PATIENT = {'server_timeout': DEADLINE, 'response_timeout': DEADLINE}


@pytest.fixture
def link() -> Iterator[ServiceLink]:
    with NodeRuntime.open('asker') as runtime:
        yield ServiceLinks(runtime).link(Trigger, 'trigger')


def serve(runtime: NodeRuntime, callback: Any) -> None:
    runtime.call(lambda: runtime.node.create_service(Trigger, 'trigger', callback))


def answer(request: Any, response: Any) -> Any:
    response.success, response.message = True, 'fine'
    return response


def test_a_response(link: ServiceLink) -> None:
    outcomes: queue.Queue[ServiceOutcome] = queue.Queue()
    with NodeRuntime.open('answerer') as server:
        call = ServiceCall(
            link, Trigger.Request(), on_done=outcomes.put, server_timeout=DEADLINE, response_timeout=DEADLINE
        )
        serve(server, answer)  # appears while it is waited for
        outcome = outcomes.get(timeout=DEADLINE)
        assert outcome.response is not None and outcome.response.message == 'fine'
        assert call.done and call.outcome is outcome
        assert service_outcome(link, Trigger.Request(), DEADLINE).response == outcome.response


def test_no_service(link: ServiceLink) -> None:
    outcomes: queue.Queue[ServiceOutcome] = queue.Queue()
    ServiceCall(link, Trigger.Request(), on_done=outcomes.put, server_timeout=0.1)
    outcome = outcomes.get(timeout=DEADLINE)
    assert not outcome.ok
    assert "no service 'trigger' (std_srvs/srv/Trigger) appeared within 0.1 s" in outcome.reason


def test_no_response_in_time_and_a_late_one_is_ignored(link: ServiceLink) -> None:
    outcomes: queue.Queue[ServiceOutcome] = queue.Queue()
    release = threading.Event()

    def slow(request: Any, response: Any) -> Any:
        release.wait(DEADLINE)
        return answer(request, response)

    with NodeRuntime.open('slow') as server:
        serve(server, slow)
        ServiceCall(link, Trigger.Request(), on_done=outcomes.put, server_timeout=DEADLINE, response_timeout=0.1)
        assert 'did not answer within 0.1 s' in outcomes.get(timeout=DEADLINE).reason
        release.set()
        ServiceCall(link, Trigger.Request(), on_done=outcomes.put, **PATIENT)
        assert outcomes.get(timeout=DEADLINE).ok
        assert outcomes.empty()


@contextlib.contextmanager
def scripted_server() -> Iterator[PythonProcess]:
    with python_process(['-m', 'flexbt_testing.nodes.scripted_action_server', 'token']) as child:
        try:
            yield child
        finally:
            child.kill()


@pytest.mark.dds('another process takes part')
def test_a_service_of_a_process_that_is_killed_is_given_up_at_once(link: ServiceLink) -> None:
    runtime, outcomes = link.runtime, queue.Queue[ServiceOutcome]()
    held = ServiceLinks(runtime).link(Trigger, 'held')
    with scripted_server() as child:
        watch = LivelinessWatch(runtime, '/scripted')
        wait_until(lambda: runtime.call(held.is_ready) and watch.ready, 'the service and its token')
        ServiceCall(held, Trigger.Request(), on_done=outcomes.put, response_timeout=1e3)
        runtime.call(lambda: None)  # after it was sent
        child.kill()
        outcome = outcomes.get(timeout=DEADLINE)
    assert not outcome.ok and 'is gone' in outcome.reason
    assert runtime.call(held.is_shown) and not runtime.call(held.is_ready)
    assert 'no service' in service_outcome(held, Trigger.Request(), 0.1).reason


def test_each_part_of_a_node_watches_the_servers_that_it_calls() -> None:
    with NodeRuntime.open('host') as host, NodeRuntime.open('server') as server:
        LivelinessToken(server)
        serve(server, answer)
        for _ in range(2):
            scope = NodeScope(host)
            link = ServiceLinks(scope).link(Trigger, 'trigger')
            assert service_outcome(link, Trigger.Request(), DEADLINE).ok

            def heard(link: ServiceLink = link) -> list[str]:
                link.is_gone()
                return [one.topic_name for one in host.node.subscriptions]

            wait_until(lambda: '/server/alive' in host.call(heard), 'the token of the server')
            scope.close()


@pytest.mark.dds('another process takes part')
def test_a_service_that_hangs_is_given_up_after_its_time_and_gets_the_request_when_it_goes_on() -> None:
    with NodeRuntime.open('asker') as runtime, scripted_server() as child:
        cancel = ServiceLinks(runtime, peer_timeout=0.6).link(CancelGoal, 'wait/_action/cancel_goal')
        action = ActionLinks(runtime).link(Wait, 'wait')
        watch, outcomes = LivelinessWatch(runtime, '/scripted', timeout=0.6), queue.Queue[Any]()
        wait_until(lambda: runtime.call(cancel.is_ready) and watch.ready, 'the service and its token')
        accepted = threading.Event()
        ActionCall(action, Wait.Goal(), on_done=outcomes.put, on_accepted=accepted.set, accept_timeout=DEADLINE)
        assert accepted.wait(DEADLINE)
        child.send_signal(signal.SIGSTOP)
        wait_until(lambda: watch.alive is False, 'too late')
        assert runtime.call(cancel.is_ready)
        outcome = service_outcome(cancel, CancelGoal.Request(), DEADLINE)
        assert not outcome.ok and 'is gone' in outcome.reason
        child.send_signal(signal.SIGCONT)
        assert outcomes.get(timeout=DEADLINE).status is GoalStatus.CANCELED


def test_a_request_that_is_given_up_ends_once(link: ServiceLink) -> None:
    outcomes: queue.Queue[ServiceOutcome] = queue.Queue()
    call = ServiceCall(link, Trigger.Request(), on_done=outcomes.put, server_timeout=DEADLINE)
    call.cancel()
    call.cancel()
    assert 'given up' in outcomes.get(timeout=DEADLINE).reason
    assert outcomes.empty()


def test_a_request_of_another_type_is_refused_before_it_is_sent(link: ServiceLink) -> None:
    outcomes: queue.Queue[ServiceOutcome] = queue.Queue()
    with NodeRuntime.open('typed') as server:
        serve(server, answer)
        ServiceCall(link, SetBool.Request(), on_done=outcomes.put, server_timeout=DEADLINE)
        assert 'cannot be sent' in outcomes.get(timeout=DEADLINE).reason


def test_a_request_arrives_as_its_fields_show(link: ServiceLink) -> None:
    asked: list[Any] = []
    setter = ServiceLinks(link.runtime).link(SetBool, 'set')

    def serve_setting(request: Any, response: Any) -> Any:
        asked.append(request)
        return response

    with NodeRuntime.open('setter') as server:
        server.call(lambda: server.node.create_service(SetBool, 'set', serve_setting))
        assert service_outcome(setter, SetBool.Request(check_fields=False, data=numpy.True_), DEADLINE).ok
        assert asked[0].data is True


def test_a_call_that_is_on_its_way_while_its_node_ends_is_no_fault() -> None:
    faults: list[BaseException] = []
    with NodeRuntime.open('asker') as runtime:
        runtime.on_fault(faults.append)

        def go_on_for_some_polls() -> None:
            passed = threading.Event()
            runtime.steady.call_at(runtime.steady.now() + 0.3, passed.set)
            assert passed.wait(DEADLINE)

        runtime.on_close(go_on_for_some_polls)  # after what is registered below has closed
        service = ServiceLinks(runtime).link(Trigger, 'trigger')
        action = ActionLinks(runtime).link(Wait, 'wait')
        ServiceCall(service, Trigger.Request(), on_done=lambda outcome: None, server_timeout=DEADLINE)
        ActionCall(action, Wait.Goal(), on_done=lambda outcome: None, server_timeout=DEADLINE)
    assert faults == []


@pytest.mark.parametrize(('links_of', 'kind', 'entities'), [(ServiceLinks, Trigger, 1), (ActionLinks, Wait, 5)])
def test_names_of_servers_do_not_fill_the_memory(
    links_of: type[Any], kind: Any, entities: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(links_module, 'MOST_LINKS', most := 10)
    with NodeRuntime.open('calls') as runtime:
        links = links_of(runtime)
        held = links.link(kind, 'held')
        used = weakref.ref(links.link(kind, 'used'))
        for number in range(most + 5):
            links.link(kind, f'name{number}')
            assert links.link(kind, 'used') is used()

        def left() -> int:
            node = runtime.node
            topics = [one for one in node.subscriptions if '/_action/' in one.topic_name]
            return len([*node.clients, *topics])

        wait_until(lambda: runtime.call(left) == entities * (most + 1), 'they are destroyed')
        assert links.link(kind, 'held') is held
