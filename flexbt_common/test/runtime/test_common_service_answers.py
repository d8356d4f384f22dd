# SPDX-License-Identifier: BSD-3-Clause
"""Answers of services to clients that the middleware has not discovered yet."""

from __future__ import annotations

import time
from typing import Any

import pytest
from rclpy.service import Service
from std_srvs.srv import Trigger

from flexbt_common.calls import ServiceLinks, service_outcome
from flexbt_common.runtime import NodeRuntime, rclpy_private
from flexbt_testing.waiting import DEADLINE, wait_until


@pytest.mark.skipif(
    not rclpy_private.is_usable(rclpy_private.EXECUTOR), reason="rclpy's own executor sends an answer once"
)
@pytest.mark.parametrize('unsent', [1, 3, 99])
def test_an_answer_that_was_left_unsent_is_sent_again_for_a_while(unsent: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(rclpy_private, 'UNSENT_SECONDS', 0.02)
    monkeypatch.setattr(rclpy_private, 'AGAIN_SECONDS', (0.01, 0.01, 0.01))
    real = Service.send_response
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
            time.sleep(0.02)

    monkeypatch.setattr(Service, 'send_response', send)
    with NodeRuntime.open('server') as server, NodeRuntime.open('client') as client:
        server.call(lambda: server.node.create_service(Trigger, 'answer', lambda request, response: response))
        link = ServiceLinks(client).link(Trigger, 'answer')
        if unsent < 99:
            assert service_outcome(link, Trigger.Request(), DEADLINE).response is not None
            assert len(sent) == unsent + 1
        else:
            assert service_outcome(link, Trigger.Request(), 0.5).response is None
            wait_until(lambda: len(sent) == 4, 'the last attempt')
