# SPDX-License-Identifier: BSD-3-Clause
"""Floods a topic or a service: so many messages or requests a second, as they are when nothing is filled in.

Usage: python3 _flood.py NAME TYPE RATE    (TYPE as in the graph: std_msgs/msg/Bool)
"""

from __future__ import annotations

import importlib
import os
import sys
import time
from collections.abc import Callable
from typing import Any, Final

import rclpy
from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.qos import LivelinessPolicy
from rclpy.serialization import serialize_message
from rclpy.signals import SignalHandlerOptions

from flexbt_common import names
from flexbt_common.liveness import LEASE_SECONDS

TURN_SECONDS: Final = 0.01


def main(name: str, type_name: str, rate: float) -> None:
    """Until the end of who has started it. A line on standard output says that it has begun."""
    parent = os.getppid()
    rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
    node = rclpy.create_node('flooder')
    package, kind, base = type_name.split('/')
    module = importlib.import_module(f'{package}.{kind}')
    send = _messages(node, name, getattr(module, base)) if kind == 'msg' else _requests(node, name, module, base)
    sent, began = 0, time.monotonic()
    while os.getppid() == parent:
        while sent < (time.monotonic() - began) * rate:
            send()
            sent += 1
            if sent == 1:
                print('floods', flush=True)
        time.sleep(TURN_SECONDS)


def _messages(node: Node, topic: str, message_type: Any) -> Callable[[], object]:
    profile = names.latched(100)
    if topic.endswith('/alive'):
        profile.liveliness = LivelinessPolicy.MANUAL_BY_TOPIC
        profile.liveliness_lease_duration = Duration(seconds=LEASE_SECONDS)
    publisher = node.create_publisher(message_type, topic, profile)
    message = serialize_message(message_type())
    while not publisher.get_subscription_count():
        time.sleep(TURN_SECONDS)
    return lambda: publisher.publish(message)


def _requests(node: Node, service: str, module: Any, base: str) -> Callable[[], object]:
    action, _, part = base.rpartition('_')
    service_type = getattr(getattr(module, action).Impl, f'{part}Service') if action else getattr(module, base)
    client = node.create_client(service_type, service)
    client.wait_for_service()
    request = service_type.Request()

    def send() -> None:
        if part == 'SendGoal':
            request.goal_id.uuid = list(os.urandom(16))
        client.handle.send_request(request)  # nobody waits for the answer

    return send


if __name__ == '__main__':
    main(sys.argv[1], sys.argv[2], float(sys.argv[3]))
