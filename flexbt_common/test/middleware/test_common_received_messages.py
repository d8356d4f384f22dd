# SPDX-License-Identifier: BSD-3-Clause
"""Messages of anybody: who has written each, however large or wrong it is, and however many come."""

from __future__ import annotations

import itertools
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from typing import Any

import pytest
from rclpy.qos import QoSProfile
from std_msgs.msg import String

from flexbt_common.middleware import received_messages
from flexbt_common.middleware.fastdds import can_ignore, ignore_each_other, ignore_participant
from flexbt_common.middleware.received_messages import (
    UNKNOWN_WRITER,
    LatestMessage,
    Received,
    ReceivedMessages,
    reports_writers,
    writer_name,
)
from flexbt_common.runtime.node_runtime import NodeRuntime
from flexbt_common.runtime.pace import Pace
from flexbt_common.values.limits import deserialize
from flexbt_testing.waiting import wait_until

TOPIC = 'what_comes'
QOS = QoSProfile(depth=1000)
LIMIT = 1000


class Receiver:
    """What a node has received."""

    def __init__(self, runtime: NodeRuntime) -> None:
        self.runtime = runtime
        self.received: list[Received] = []
        runtime.call(lambda: ReceivedMessages(runtime.node, String, TOPIC, QOS, self.received.append, LIMIT))

    def wait_for(self, count: int) -> list[Received]:
        """Wait for so many messages, and give them."""
        wait_until(lambda: len(self.received) >= count, lambda: f'{count} messages; {len(self.received)} have come')
        return self.received


class Sender:
    """A publisher on a node of its own."""

    def __init__(self, name: str, message_type: type[Any] = String) -> None:
        self.runtime = NodeRuntime(name, args=())
        self.publisher = self.runtime.call(lambda: self.runtime.node.create_publisher(message_type, TOPIC, QOS))
        wait_until(self.publisher.get_subscription_count, 'the receiver')


@pytest.fixture
def receiver() -> Iterator[Receiver]:
    with NodeRuntime.open('receiver') as runtime:
        yield Receiver(runtime)


@pytest.mark.skipif(not reports_writers(), reason='rclpy as it is does not tell writers')
def test_the_writer_of_a_message_is_known_and_what_is_too_large_is_not_unpacked(receiver: Receiver) -> None:
    first, second = Sender('first'), Sender('second')
    try:
        wait_until(lambda: {'first', 'second'} <= set(receiver.runtime.node.get_node_names()), 'their names')
        first.publisher.publish(String(data='a'))
        first.publisher.publish(String(data='x' * 10_000_000))
        second.publisher.publish(String(data='b'))
        received = receiver.wait_for(3)
        by_writer: dict[str, list[Received]] = {}
        for one in received:
            by_writer.setdefault(writer_name(receiver.runtime.node, TOPIC, one.writer), []).append(one)
        assert set(by_writer) == {'/first', '/second'}
        small, large = by_writer['/first']
        assert (small.unpack(String).data, large.data, large.size > 10_000_000) == ('a', None, True)
        with pytest.raises(ValueError, match='too many'):
            large.unpack(String)
        assert by_writer['/second'][0].unpack(String).data == 'b'
        assert abs(small.sent - large.sent) < 60.0
        second.runtime.close()
        wait_until(lambda: not writer_name(receiver.runtime.node, TOPIC, by_writer['/second'][0].writer), 'gone')
    finally:
        first.runtime.close()
        second.runtime.close()


@pytest.mark.parametrize('size', range(8))
def test_a_few_bytes_are_no_message(size: int) -> None:
    with pytest.raises(ValueError, match='are not a String'):
        Received(bytes(size), size, UNKNOWN_WRITER, 0.0).unpack(String)


def test_bytes_that_are_no_message_are_told_as_such(receiver: Receiver) -> None:
    sender = Sender('sender')
    try:
        for data in (b'\x00\x01', b'\x00\x01\x00\x00\xff\xff\xff\x7fabc'):
            sender.publisher.publish(data)
        sender.publisher.publish(String(data='good'))
        received = receiver.wait_for(1)
        wait_until(lambda: received[-1].data and b'good' in received[-1].data, 'the last')
        for one in received[:-1]:
            with pytest.raises(ValueError, match='are not a String'):
                one.unpack(String)
        assert received[-1].unpack(String).data == 'good'
    finally:
        sender.runtime.close()


def test_without_the_private_parts_of_rclpy_writers_are_unknown(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv('FLEXBT_STOCK_RCLPY', '1')
    with NodeRuntime.open('receiver') as runtime:
        receiver = Receiver(runtime)
        sender = Sender('sender')
        try:
            sender.publisher.publish(String(data='x' * 2000))
            sender.publisher.publish(String(data='a'))
            large, small = receiver.wait_for(2)
            assert (large.data, small.unpack(String).data, small.writer) == (None, 'a', UNKNOWN_WRITER)
            assert writer_name(runtime.node, TOPIC, UNKNOWN_WRITER) == ''
        finally:
            sender.runtime.close()


@pytest.mark.dds('it is about Fast DDS')
@pytest.mark.skipif(not can_ignore(), reason='needs a known version of Fast DDS')
@pytest.mark.skipif(not reports_writers(), reason='rclpy as it is does not tell writers')
def test_nothing_more_is_heard_of_a_participant_that_is_ignored(receiver: Receiver) -> None:
    bad, good = Sender('bad'), Sender('good')
    try:
        bad.publisher.publish(String(data='a'))
        (first,) = receiver.wait_for(1)
        assert receiver.runtime.call(lambda: ignore_participant(receiver.runtime.node, first.participant))
        for _ in range(10):
            bad.publisher.publish(String(data='b'))
            good.publisher.publish(String(data='c'))
        received = receiver.wait_for(11)
        assert [one.unpack(String).data for one in received] == ['a', *'c' * 10]
        assert not receiver.runtime.call(lambda: ignore_participant(receiver.runtime.node, b'no such'))
    finally:
        bad.runtime.close()
        good.runtime.close()


PARTICIPANTS = """
import sys
import rclpy
from rclpy.context import Context
from rclpy.qos import QoSProfile
from std_msgs.msg import String

publishers = []
for number in range(3):
    context = Context()
    rclpy.init(context=context)
    node = rclpy.create_node(f'part{number}', context=context)
    publishers.append(node.create_publisher(String, sys.argv[1], QoSProfile(depth=1000)))
for line in sys.stdin:
    for publisher in publishers:
        if publisher.get_subscription_count():
            publisher.publish(String(data=line.strip()))
"""


@pytest.mark.dds('another process takes part')
@pytest.mark.skipif(not can_ignore(), reason='needs a known version of Fast DDS')
@pytest.mark.skipif(not reports_writers(), reason='rclpy as it is does not tell writers')
def test_the_participants_of_a_process_share_what_it_may_send(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(received_messages, 'EXCESS_BYTES', 10 * LIMIT)
    received: list[Received] = []
    told: list[str] = []
    with NodeRuntime.open('receiver') as runtime:
        runtime.call(
            lambda: ReceivedMessages(runtime.node, String, TOPIC, QOS, received.append, LIMIT, on_ignored=told.append)
        )
        good = Sender('good')
        words = [sys.executable, '-c', PARTICIPANTS, TOPIC]
        with subprocess.Popen(words, stdin=subprocess.PIPE, text=True) as child:
            assert child.stdin is not None

            def all_heard() -> bool:
                assert child.stdin is not None
                child.stdin.write('a\n')
                child.stdin.flush()
                return len({one.participant for one in received}) == 3

            wait_until(all_heard, 'all participants')
            assert len({one.process for one in received}) == 1
            received.clear()
            good.publisher.publish(String(data='b'))
            wait_until(lambda: received, 'the other process')

            def is_silent() -> bool:
                assert child.stdin is not None
                large = [one for one in received if one.data is None]
                for _ in range(3):
                    child.stdin.write('x' * (2 * LIMIT) + '\n')
                child.stdin.flush()
                runtime.call(lambda: None)
                is_whole = len({one.participant for one in large}) == 3 and bool(told)
                return is_whole and large == [one for one in received if one.data is None]

            wait_until(is_silent, 'nothing more of that process')
            assert len(told) == 1 and 'nothing more is heard of its process' in told[0]
            child.kill()
        count = len(received)
        good.publisher.publish(String(data='c'))
        wait_until(lambda: len(received) > count, 'the other process, all the same')
        good.runtime.close()


def test_a_flood_that_cannot_be_ignored_is_not_looked_for_again_and_again(monkeypatch: pytest.MonkeyPatch) -> None:
    sought: list[bytes] = []
    monkeypatch.setattr(received_messages, 'ignore_participant', lambda *_: False)
    monkeypatch.setattr(received_messages, 'writer_name', lambda _node, _topic, writer: sought.append(writer))
    monkeypatch.setattr(received_messages, 'EXCESS_MESSAGES', most := 10)
    with NodeRuntime.open('receiver') as runtime:
        messages = runtime.call(lambda: ReceivedMessages(runtime.node, String, TOPIC, QOS, print, LIMIT))
        for _ in range(3 * most):
            messages.blame(Received(b'', 0, b'1' * 16, 0.0))
    assert sought == [b'1' * 12]


@pytest.mark.dds('it is about Fast DDS')
@pytest.mark.skipif(not can_ignore(), reason='needs a known version of Fast DDS')
def test_nodes_that_ignore_each_other_are_there_for_everybody_else() -> None:
    with NodeRuntime.open('first') as first, NodeRuntime.open('other') as other, NodeRuntime.open('third') as third:
        ignore_each_other(first.node, other.node)
        publisher = other.call(lambda: other.node.create_publisher(String, TOPIC, QOS))
        received: dict[str, list[str]] = {'first': [], 'third': []}
        for runtime in (first, third):
            heard = received[runtime.name]

            def hear(runtime: NodeRuntime = runtime, heard: list[str] = heard) -> None:
                runtime.node.create_subscription(String, TOPIC, lambda message: heard.append(message.data), QOS)

            runtime.call(hear)
        wait_until(lambda: {'first', 'other'} <= set(third.node.get_node_names()), 'both')
        wait_until(lambda: publisher.get_subscription_count() == 1, 'the third one')
        publisher.publish(String(data='a'))
        wait_until(lambda: received['third'] == ['a'], 'the message')
        assert publisher.get_subscription_count() == 1 and not received['first']
        assert third.node.count_publishers(TOPIC) == 1 and first.node.count_publishers(TOPIC) == 0


def test_what_takes_long_leaves_most_of_the_executors_time_to_others_and_loses_nothing() -> None:
    taken: list[float] = []
    with NodeRuntime.open('receiver') as runtime, NodeRuntime.open('sender') as sender:
        pace = Pace(runtime)

        def take(received: Received) -> None:
            with pace.work():
                until = time.monotonic() + 0.1
                while time.monotonic() < until:  # as a message with much in it does
                    pass
            taken.append(time.monotonic())

        def join() -> None:
            ReceivedMessages(runtime.node, String, TOPIC, QOS, take, LIMIT, is_awaited=pace.is_over)

        runtime.call(join)
        publisher = sender.call(lambda: sender.node.create_publisher(String, TOPIC, QOS))
        wait_until(publisher.get_subscription_count, 'the receiver')
        count = 4
        for _ in range(count):
            publisher.publish(String())
        wait_until(lambda: len(taken) == count, lambda: f'{len(taken)} of {count} messages')
        between = [after - before for before, after in itertools.pairwise(taken)]
        assert all(one >= 0.1 + Pace.RESTS * 0.1 - Pace.BURST_SECONDS - 0.01 for one in between), between


def test_the_newest_message_is_the_one_before_a_message_that_is_none() -> None:
    """A stop of the robot asks for its newest pose, whatever else comes on that topic."""
    with NodeRuntime.open('receiver') as runtime:
        latest = runtime.call(lambda: LatestMessage(runtime.node, String, TOPIC, QOS))
        sender = Sender('sender')
        cut = b'\0\1\0\0\x64\0\0\0a\0'  # a text of 100 characters that ends after one
        sender.publisher.publish(cut)
        sender.publisher.publish(String(data='good'))
        wait_until(lambda: latest.message == String(data='good'), lambda: f'the good one; {latest.message}')
        sender.publisher.publish(cut)
        wait_until(lambda: (latest.message, latest._newest)[1] == cut, 'the next bad one')
        assert latest.message == String(data='good')
        sender.publisher.publish(String(data='better'))
        wait_until(lambda: latest.message == String(data='better'), 'the next good one')
        sender.runtime.close()


def test_a_message_is_one_object_for_all_threads(monkeypatch: pytest.MonkeyPatch) -> None:
    """Leaves of several trees tell by that whether a newer one has come."""
    with NodeRuntime.open('receiver') as runtime, ThreadPoolExecutor(2) as readers:
        arrived = threading.Event()
        latest = runtime.call(lambda: LatestMessage(runtime.node, String, TOPIC, QOS, arrived.set, lambda: True))
        together = threading.Barrier(2)

        def slow(data: bytes, message_type: type[Any]) -> Any:
            with suppress(threading.BrokenBarrierError):
                together.wait(0.1)  # for another thread that makes it too
            return deserialize(data, message_type)

        sender = Sender('sender')
        sender.publisher.publish(String(data='first'))
        wait_until(arrived.is_set, 'the message')
        monkeypatch.setattr(received_messages, 'deserialize', slow)
        one, other = readers.map(lambda _: latest.message, range(2))
        assert one is other
        sender.runtime.close()
