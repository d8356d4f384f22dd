# SPDX-License-Identifier: BSD-3-Clause
"""The room of large messages is given back when they have been taken, whatever number of topics had one."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest
from rcl_interfaces.srv import DescribeParameters
from rclpy.qos import QoSProfile, qos_profile_services_default
from rclpy.serialization import serialize_message
from std_msgs.msg import String

from flexbt_common import names
from flexbt_common.discovery import profile
from flexbt_common.middleware.fastdds import FAST_DDS, is_dynamic
from flexbt_common.middleware.implementation import implementation
from flexbt_common.runtime.node_runtime import NodeRuntime
from flexbt_testing.waiting import wait_until

pytestmark = pytest.mark.dds('it is about the memory of Fast DDS')

TOPICS = 6
DEPTH = 5
SIZE = 5_000_000


def resident() -> int:
    """Bytes of this process."""
    return int(Path('/proc/self/statm').read_text().split()[1]) * os.sysconf('SC_PAGE_SIZE')


def send_large(sender: NodeRuntime, receiver: NodeRuntime, topic: str) -> None:
    """As many messages as the queue is deep wait together for the receiver, which takes them."""
    taken: list[String] = []
    message = serialize_message(String(data='x' * SIZE))

    def take(_message: String) -> None:
        taken.append(String())

    receiver.call(lambda: receiver.node.create_subscription(String, topic, take, QoSProfile(depth=DEPTH)))
    publisher = sender.call(lambda: sender.node.create_publisher(String, topic, 1))
    wait_until(publisher.get_subscription_count, 'the receiver')

    def fill() -> None:
        for _ in range(DEPTH):
            publisher.publish(message)

    receiver.call(lambda: sender.call(fill))
    wait_until(lambda: taken, 'the messages')
    sender.call(lambda: sender.node.destroy_publisher(publisher))


def test_the_room_of_large_messages_is_given_back() -> None:
    with NodeRuntime.open('receiver') as receiver, NodeRuntime.open('sender') as sender:
        before = resident()
        for number in range(TOPICS):
            send_large(sender, receiver, f'large_{number}')
        kept = TOPICS * SIZE
        wait_until(lambda: resident() - before < kept, lambda: f'{(resident() - before) / 1e6:.0f} MB given back')


UNREAD = 256
"""Of the profile."""


SENDER = """
import sys
from threading import Event
from rcl_interfaces.srv import DescribeParameters
from rclpy.qos import QoSProfile
from flexbt_common.runtime.node_runtime import NodeRuntime

with NodeRuntime.open('sender') as runtime:
    for line in sys.stdin:
        count, depth = map(int, line.split())
        qos = QoSProfile(depth=depth)
        client = runtime.call(lambda: runtime.node.create_client(DescribeParameters, 'describe', qos_profile=qos))
        found, known = client.wait_for_service(20.0), Event()
        first = runtime.call(lambda: client.call_async(DescribeParameters.Request()))
        first.add_done_callback(lambda _: known.set())
        print(found and known.wait(20.0), flush=True)
        sys.stdin.readline()
        for number in range(count):
            runtime.call(lambda: client.call_async(DescribeParameters.Request(names=[str(number)])))
        print('sent', flush=True)
"""
"""A process that sends so many requests, by a queue of such a depth, for two lines that it is given: after the first it
waits for an answer, since what is sent to a service that has not discovered its client waits in that queue."""


@pytest.mark.skipif(implementation() != FAST_DDS, reason='needs Fast DDS')
def test_few_requests_of_a_service_wait_unread_and_none_is_lost_for_that() -> None:
    """Of processes: within one, Fast DDS sends nothing again."""
    sender = subprocess.Popen([sys.executable, '-c', SENDER], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
    with sender, NodeRuntime.open('receiver') as receiver:
        assert sender.stdin is not None and sender.stdout is not None
        to_sender, from_sender = sender.stdin, sender.stdout
        taken: list[str] = []

        def serve(
            request: DescribeParameters.Request, response: DescribeParameters.Response
        ) -> DescribeParameters.Response:
            taken.extend(request.names)
            return response

        def ask(line: str) -> str:
            print(line, file=to_sender, flush=True)
            return from_sender.readline().strip()

        def send(count: int, depth: int) -> None:
            assert ask(f'{count} {depth}') == 'True'
            taken.clear()
            assert receiver.call(lambda: ask('go')) == 'sent'  # nothing is taken meanwhile
            wait_until(lambda: str(count - 1) in taken, 'the last request')

        receiver.call(lambda: receiver.node.create_service(DescribeParameters, 'describe', serve))
        send(4 * UNREAD, 1)  # its sender keeps nothing, so what did not wait here is lost
        assert len(taken) < 3 * UNREAD
        send(50, qos_profile_services_default.depth)
        assert taken == [str(number) for number in range(50)]
        send(2 * UNREAD, names.service_qos().depth)
        assert taken == [str(number) for number in range(2 * UNREAD)]
        to_sender.close()


DYNAMIC = '<historyMemoryPolicy>DYNAMIC</historyMemoryPolicy>'
BOTH = ''.join(
    f'<{tag} profile_name="all" is_default_profile="true">{DYNAMIC}</{tag}>' for tag in ('data_writer', 'data_reader')
)
CAMERA = '<data_reader profile_name="camera">{}</data_reader>'


@pytest.mark.parametrize('name', ['this_computer', 'network', 'radio_robot', 'radio_console'])
def test_each_profile_that_comes_along_has_it_given_back(name: str) -> None:
    assert is_dynamic(profile(name))


@pytest.mark.parametrize(
    ('profiles', 'is_so'),
    [
        (BOTH, True),
        (BOTH.replace('data_writer', 'publisher').replace('data_reader', 'subscriber'), True),
        (BOTH + CAMERA.format(DYNAMIC), True),
        (BOTH + CAMERA.format(''), False),
        (CAMERA.format(DYNAMIC), False),
        (BOTH.replace('data_reader', 'data_writer'), False),
        (BOTH.replace('"true"', '"false"'), False),
        (BOTH.replace('DYNAMIC', 'PREALLOCATED', 1), False),
        (f'<!-- {BOTH} -->', False),
        (BOTH + '<', False),
    ],
)
def test_a_profile_that_leaves_some_topic_without_it_is_not_heeded(profiles: str, is_so: bool, tmp_path: Path) -> None:
    """Fast DDS would refuse what is larger than the first message of that topic."""
    file = tmp_path / 'profile.xml'
    file.write_text(f'<dds><profiles>{profiles}</profiles></dds>', encoding='utf-8')
    assert is_dynamic(file) is is_so
    assert not is_dynamic(tmp_path)
