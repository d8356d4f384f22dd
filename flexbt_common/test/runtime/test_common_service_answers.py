# SPDX-License-Identifier: BSD-3-Clause
"""Answers of services to clients that the middleware has not discovered yet."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest
from rclpy.action.server import RCLError
from rclpy.service import Service
from std_srvs.srv import Trigger

from flexbt_common.calls.service_call import ServiceLinks, service_outcome
from flexbt_common.runtime import node_runtime
from flexbt_common.runtime.node_runtime import AGAIN_SECONDS, MOST_UNSENT, UNSENT_SECONDS, AnswerResender, NodeRuntime
from flexbt_core.clock.clock import ManualClock
from flexbt_testing.waiting import DEADLINE, wait_until


@pytest.mark.parametrize('unsent', [1, 3, 99])
def test_an_answer_that_was_left_unsent_is_sent_again_for_a_while(unsent: int, monkeypatch: pytest.MonkeyPatch) -> None:
    real, clock = Service.send_response, ManualClock()
    sent: list[Any] = []

    def send(service: Service, response: Any, header: Any) -> None:
        """As rmw_fastrtps before it has discovered the client."""
        if service.srv_name != 'answer':
            real(service, response, header)
            return
        sent.append(response)
        if len(sent) > unsent:
            real(service, response, header)
        else:
            clock.advance(2.0 * UNSENT_SECONDS)

    with NodeRuntime.open('server') as server, NodeRuntime.open('client') as client:
        server.call(lambda: server.node.create_service(Trigger, 'answer', lambda request, response: response))
        link = ServiceLinks(client).link(Trigger, 'answer')
        assert service_outcome(link, Trigger.Request(), DEADLINE).response is not None  # they know each other by now
        monkeypatch.setattr(node_runtime, 'AGAIN_SECONDS', (0.01, 0.01, 0.01))
        monkeypatch.setattr(node_runtime, 'monotonic', clock.now)
        monkeypatch.setattr(Service, 'send_response', send)
        if unsent < 99:
            assert service_outcome(link, Trigger.Request(), DEADLINE).response is not None
            assert len(sent) == unsent + 1
        else:
            assert service_outcome(link, Trigger.Request(), 0.5).response is None
            wait_until(lambda: len(sent) == 4, 'the last attempt')


def test_an_answer_of_a_service_that_is_gone_meanwhile_is_no_fault(monkeypatch: pytest.MonkeyPatch) -> None:
    again: list[Callable[[], object]] = []
    sent: list[Any] = []

    def send(service: Service, response: Any, _header: Any) -> None:
        with service.handle:
            sent.append(response)

    monkeypatch.setattr(node_runtime, 'UNSENT_SECONDS', 0.0)
    monkeypatch.setattr(Service, 'send_response', send)
    with NodeRuntime.open('server') as server:
        service = server.call(lambda: server.node.create_service(Trigger, 'answer', lambda request, response: response))
        answers = AnswerResender(service, lambda _seconds, fn: again.append(fn))
        server.call(lambda: answers.send(Trigger.Response(), None))
        server.call(lambda: server.node.destroy_service(service))
        server.call(again[0])
    assert len(sent) == len(again) == 1


def test_an_answer_to_a_client_that_is_gone_meanwhile_is_no_fault_and_leaves_room_for_others(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    again: list[Callable[[], object]] = []

    def fail(_service: Service, _response: Any, _header: Any) -> None:
        raise RCLError('the client is gone')

    monkeypatch.setattr(node_runtime, 'UNSENT_SECONDS', 0.0)
    with NodeRuntime.open('server') as server:
        service = server.call(lambda: server.node.create_service(Trigger, 'answer', lambda request, response: response))
        answers = AnswerResender(service, lambda _seconds, fn: again.append(fn))
        for _ in range(MOST_UNSENT + 1):
            with monkeypatch.context() as patched:
                patched.setattr(Service, 'send_response', lambda *_: None)
                answers.send(Trigger.Response(), None)
                patched.setattr(Service, 'send_response', fail)
                again.pop()()
    assert again == []


def test_of_many_answers_that_nobody_gets_only_some_are_sent_again(monkeypatch: pytest.MonkeyPatch) -> None:
    again: list[Callable[[], object]] = []
    sent: list[Any] = []
    monkeypatch.setattr(node_runtime, 'UNSENT_SECONDS', 0.0)
    monkeypatch.setattr(Service, 'send_response', lambda _service, response, _header: sent.append(response))
    with NodeRuntime.open('server') as server:
        service = server.call(lambda: server.node.create_service(Trigger, 'answer', lambda request, response: response))
        answers = AnswerResender(service, lambda _seconds, fn: again.append(fn))
        for round_of in range(1, 3):  # after the last attempt there is room for others
            for _ in range(20):
                answers.send(Trigger.Response(), None)
            while again:
                again.pop(0)()
            assert len(sent) == round_of * (20 + MOST_UNSENT * len(AGAIN_SECONDS))
