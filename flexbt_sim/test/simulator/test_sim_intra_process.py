# SPDX-License-Identifier: BSD-3-Clause
"""Messages between nodes of one process: all of them, in their order, once, and to others as ever."""

from __future__ import annotations

import math
import threading
import time

import pytest
from rclpy.serialization import serialize_message
from std_msgs.msg import Int32

from flexbt_common.middleware.received_messages import Received, reports_writers
from flexbt_common.runtime.node_runtime import NodeRuntime
from flexbt_sim import intra_process
from flexbt_sim.intra_process import IntraProcessMessages, IntraProcessTopics
from flexbt_testing.waiting import DEADLINE, wait_until

COUNT = 2000


def test_what_is_handed_over_comes_once_in_order_and_on_one_thread_at_a_time(monkeypatch: pytest.MonkeyPatch) -> None:
    here = threading.get_ident()
    heard: list[tuple[int, int]] = []
    elsewhere: list[int] = []
    commands: list[int] = []
    calling = threading.Lock()
    topics = IntraProcessTopics()

    def hear(received: Received) -> None:
        assert calling.acquire(blocking=False), 'two threads call at once'
        heard.append((received.unpack(Int32).data, threading.get_ident()))
        calling.release()

    def work() -> None:
        """Do what the executor does meanwhile."""
        assert calling.acquire(blocking=False), 'two threads call at once'
        time.sleep(0.0002)
        calling.release()

    faults: list[BaseException] = []
    with NodeRuntime.open('receiver') as receiver, NodeRuntime.open('sender') as sender:
        receiver.on_fault(faults.append)
        subscription = receiver.call(
            lambda: receiver.node.create_subscription(Int32, 'commands', lambda one: commands.append(one.data), 1)
        )
        poses = topics.publisher(sender.call(lambda: sender.node.create_publisher(Int32, 'poses', 10)))
        orders = topics.publisher(sender.call(lambda: sender.node.create_publisher(Int32, 'commands', 10)))
        assert topics.is_offered('/poses', Int32) and not topics.is_offered('/poses', Received)
        messages = IntraProcessMessages(receiver, COUNT, hear, lambda: True)
        topics.receive('/poses', Int32, messages.put)
        topics.receive_instead(subscription, lambda message: commands.append(message.data))
        wait_until(lambda: orders._publisher.get_subscription_count() == 1, 'the receiver is not found')
        assert poses.get_subscription_count() == 1 and orders.get_subscription_count() == 1
        for number in range(COUNT):
            if number % 3 == 0:
                receiver.post(work)
            poses.publish(serialize_message(Int32(data=number)))
            orders.publish(Int32(data=number))
        wait_until(lambda: len(heard) >= COUNT, 'a message is missing')
        assert [number for number, _ in heard] == list(range(COUNT))
        assert commands == list(range(COUNT))  # at once, and not a second time by the middleware

        def is_heard_here() -> bool:
            poses.publish(serialize_message(Int32(data=COUNT)))
            return heard[-1] == (COUNT, here)

        if reports_writers():  # rclpy's own executor has nobody call in its place
            wait_until(is_heard_here, 'an executor that only waits has others call')
        busy, go_on = threading.Event(), threading.Event()

        def hold_up() -> None:
            busy.set()
            go_on.wait(DEADLINE)

        receiver.post(hold_up)
        assert busy.wait(DEADLINE)
        last = heard[-1]
        poses.publish(serialize_message(Int32(data=-1)))
        assert heard[-1] == last  # nobody is waited for
        go_on.set()
        wait_until(lambda: heard[-1][0] == -1, 'what has come while the executor was busy')
        assert heard[-1][1] != here

        other = sender.call(
            lambda: sender.node.create_subscription(Int32, 'commands', lambda one: elsewhere.append(one.data), 10)
        )
        wait_until(lambda: orders.get_subscription_count() == 2, 'the other one is not found')
        orders.publish(Int32(data=-1))
        wait_until(lambda: elsewhere == [-1] and commands[COUNT:] == [-1], 'not everybody has heard it')
        busy.clear()
        go_on.clear()
        receiver.post(hold_up)
        assert busy.wait(DEADLINE)
        with monkeypatch.context() as patched:  # however long it takes until the other one is known to be gone
            patched.setattr(intra_process, 'LINGER_SECONDS', math.inf)
            orders.publish(Int32(data=-2))
        sender.call(lambda: sender.node.destroy_subscription(other))
        wait_until(lambda: orders.get_subscription_count() == 1, 'the other one is not gone')
        orders.publish(Int32(data=-3))
        go_on.set()
        wait_until(lambda: len(commands) > COUNT + 1, 'no command has come')
        receiver.call(lambda: None)
        orders.publish(Int32(data=-4))
        wait_until(lambda: -4 in commands, 'a command is missing')
        assert commands[COUNT:] == sorted(commands[COUNT:], reverse=True)  # none has overtaken another one
        topics.forget(subscription)
        orders.publish(Int32(data=-5))
        wait_until(lambda: commands[-1] == -5, 'who is no receiver any more has not heard it')
        topics.withdraw(poses)
        assert not topics.is_offered('/poses', Int32)
    assert faults == []


def test_a_message_that_nobody_waits_for_is_heard_when_somebody_asks() -> None:
    heard: list[int] = []
    with NodeRuntime.open('receiver') as receiver:
        messages = IntraProcessMessages(receiver, 1, lambda one: heard.append(one.size), lambda: False)
        for data in (b'ab', b'abc'):
            messages.put(data)
        receiver.call(lambda: None)
        assert heard == []
        receiver.call(messages.take)
        assert heard == [3]  # the newest, as the depth says
