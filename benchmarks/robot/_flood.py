# SPDX-License-Identifier: BSD-3-Clause
"""Floods a topic or a service: so many messages or requests a second, as they are when nothing is filled in.

Usage: python3 _flood.py topic|service NAME TYPE RATE PARENT    (TYPE as in the graph: std_msgs/msg/Bool; PARENT: the
                                                                process with which it ends)
"""

from __future__ import annotations

import ctypes
import importlib
import os
import signal
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
from flexbt_common.lifecycle.liveliness import LEASE_SECONDS

TURN_SECONDS: Final = 0.01
PR_SET_PDEATHSIG: Final = 1  # prctl(2)


def main(what: str, name: str, type_name: str, rate: float, parent: int) -> None:
    """Until the end of who has started it. A line on standard output says that it has begun."""
    ctypes.CDLL(None).prctl(PR_SET_PDEATHSIG, signal.SIGKILL)
    if os.getppid() != parent:
        return
    rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
    node = rclpy.create_node('flooder')
    send = _messages(node, name, type_name) if what == 'topic' else _requests(node, name, type_name)
    sent, began = 0, time.monotonic()
    while True:
        while sent < (time.monotonic() - began) * rate:
            send()
            sent += 1
            if sent == 1:
                print('floods', flush=True)
        time.sleep(TURN_SECONDS)


def _type_of(type_name: str, suffix: str = '') -> tuple[Any, str]:
    """Return a type, and which part of an action it is, if it is one: of what this has an own name with a suffix."""
    package, kind, base = type_name.split('/')
    module = importlib.import_module(f'{package}.{kind}')
    action, _, part = base.rpartition('_')
    return getattr(getattr(module, action).Impl, f'{part}{suffix}') if action else getattr(module, base), part


def _messages(node: Node, topic: str, type_name: str) -> Callable[[], object]:
    message_type, _ = _type_of(type_name)
    profile = names.transient_local_qos(100)
    if topic.endswith('/alive'):
        profile.liveliness = LivelinessPolicy.MANUAL_BY_TOPIC
        profile.liveliness_lease_duration = Duration(seconds=LEASE_SECONDS)
    publisher = node.create_publisher(message_type, topic, profile)
    message = serialize_message(message_type())
    while not publisher.get_subscription_count():
        time.sleep(TURN_SECONDS)
    return lambda: publisher.publish(message)


def _requests(node: Node, service: str, type_name: str) -> Callable[[], object]:
    service_type, part = _type_of(type_name, 'Service')
    client = node.create_client(service_type, service)
    client.wait_for_service()
    request = service_type.Request()

    def send() -> None:
        if part == 'SendGoal':
            request.goal_id.uuid = list(os.urandom(16))
        client.handle.send_request(request)  # nobody waits for the answer

    return send


if __name__ == '__main__':
    main(sys.argv[1], sys.argv[2], sys.argv[3], float(sys.argv[4]), int(sys.argv[5]))
