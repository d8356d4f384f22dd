# SPDX-License-Identifier: BSD-3-Clause
"""Topics whose two ends do not fit each other: who is told what."""

from __future__ import annotations

from types import SimpleNamespace

import pytest
from rclpy.duration import Duration
from rclpy.qos import DurabilityPolicy, LivelinessPolicy, QoSProfile, ReliabilityPolicy
from std_msgs.msg import String

from flexbt_common.middleware.received_messages import LatestMessage
from flexbt_common.runtime.node_runtime import NodeRuntime, qos_misfit
from flexbt_testing.waiting import wait_until

DEFAULT = QoSProfile(depth=1)
SENSOR = QoSProfile(depth=5, reliability=ReliabilityPolicy.BEST_EFFORT)
LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
BOTH = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT, durability=DurabilityPolicy.VOLATILE)
IN_TIME = QoSProfile(depth=1, deadline=Duration(seconds=1.0))
BY_HAND = QoSProfile(depth=1, liveliness=LivelinessPolicy.MANUAL_BY_TOPIC)


@pytest.mark.parametrize(
    ('offered', 'wanted', 'words'),
    [
        (SENSOR, DEFAULT, 'it publishes BEST_EFFORT, /robot subscribes RELIABLE. Subscribe with BEST_EFFORT, or'),
        (DEFAULT, LATCHED, 'it publishes VOLATILE, /robot subscribes TRANSIENT_LOCAL. Subscribe with VOLATILE, or'),
        (BOTH, LATCHED, 'BEST_EFFORT and VOLATILE, /robot subscribes RELIABLE and TRANSIENT_LOCAL. Subscribe'),
        (DEFAULT, IN_TIME, 'deadline'),
        (DEFAULT, BY_HAND, 'liveliness'),
    ],
)
def test_the_subscriber_is_told_who_publishes_what_and_what_to_do(
    offered: QoSProfile, wanted: QoSProfile, words: str
) -> None:
    told: list[str] = []
    with NodeRuntime.open('camera', namespace='/front') as other, NodeRuntime.open('robot') as runtime:
        runtime.node.qos_misfits.on_found(told.append)
        other.call(lambda: other.node.create_publisher(String, '/seen', offered))
        runtime.call(lambda: runtime.node.create_subscription(String, 'seen', lambda _: None, wanted))
        wait_until(lambda: told, 'a warning')
        wait_until(lambda: "No messages on '/seen' from /front/camera: " in qos_misfit(runtime, '/seen'), 'its name')
        assert words.lower() in qos_misfit(runtime, '/seen').lower()
    assert told[0].startswith("No messages on '/seen'")


def test_the_publisher_is_told_too_and_a_misfit_that_has_gone_is_forgotten() -> None:
    told: list[str] = []
    with NodeRuntime.open('robot') as runtime:
        runtime.node.qos_misfits.on_found(told.append)
        runtime.call(lambda: runtime.node.create_publisher(String, 'plan', DEFAULT))
        with NodeRuntime.open('viewer') as other:
            other.call(lambda: other.node.create_subscription(String, 'plan', lambda _: None, LATCHED))
            wait_until(lambda: 'to /viewer: /robot publishes VOLATILE, it' in qos_misfit(runtime, '/plan'), 'a misfit')
        wait_until(lambda: qos_misfit(runtime, '/plan') == '', 'the end of the misfit')
    assert told == [], 'it is for the log'


@pytest.mark.parametrize('name', ['seen', '/seen', '~/seen'])
def test_a_message_that_stays_with_the_middleware_is_missed_as_well(name: str) -> None:
    with NodeRuntime.open('camera') as other, NodeRuntime.open('robot') as runtime:
        topic = runtime.node.resolve_topic_name(name)
        other.call(lambda: other.node.create_publisher(String, topic, SENSOR))
        latest = runtime.call(lambda: LatestMessage(runtime.node, String, name, DEFAULT))
        wait_until(lambda: 'from /camera: it publishes BEST_EFFORT' in qos_misfit(runtime, topic), 'a misfit')
        assert latest.message is None


def test_many_publishers_make_one_short_line() -> None:
    told: list[str] = []
    with NodeRuntime.open('camera') as other, NodeRuntime.open('robot') as runtime:
        runtime.node.qos_misfits.on_found(told.append)
        runtime.call(lambda: runtime.node.create_subscription(String, 'seen', lambda _: None, DEFAULT))
        for _ in range(20):
            other.call(lambda: other.node.create_publisher(String, 'seen', SENSOR))

        def is_known() -> bool:
            runtime.call(lambda: runtime.node.qos_misfits.check('/seen'))
            return 'And 17 more.' in runtime.node.qos_misfits.of('/seen')

        wait_until(is_known, 'all of them')
        assert len(runtime.node.qos_misfits.of('/seen')) < 600
    assert len(told) <= 2, 'a line of the log for each'


def test_a_name_that_others_have_made_up_is_one_short_line(monkeypatch: pytest.MonkeyPatch) -> None:
    forged = SimpleNamespace(node_name='x\x1b[2J\n' * 100, node_namespace='/', qos_profile=SENSOR)
    with NodeRuntime.open('robot') as runtime:
        runtime.call(lambda: runtime.node.create_subscription(String, 'seen', lambda _: None, DEFAULT))
        monkeypatch.setattr(runtime.node, 'get_publishers_info_by_topic', lambda _topic: [forged])
        text = runtime.call(lambda: runtime.node.qos_misfits.check('/seen'))
    assert text.isprintable() and len(text) < 300
