# SPDX-License-Identifier: BSD-3-Clause
"""The subscriptions and services that trees share: apart by quality of service, and released when nobody needs them."""

from __future__ import annotations

import gc
from collections.abc import Iterator
from pathlib import Path

import pytest
from geometry_msgs.msg import PoseStamped
from rclpy.qos import QoSProfile, ReliabilityPolicy, qos_profile_sensor_data
from std_msgs.msg import Bool, String

from flexbt_common import names
from flexbt_common.runtime.node_runtime import NodeRuntime
from flexbt_server.leaves import SubscribedTopic
from flexbt_server.leaves.leaf_services import TriggerServices
from flexbt_server.leaves.topic_cache import TopicCaches
from flexbt_testing.nodes import server_nodes
from flexbt_testing.nodes.server_world import install_nodes, open_server_world
from flexbt_testing.waiting import wait_until


@pytest.fixture
def runtime() -> Iterator[NodeRuntime]:
    with NodeRuntime.open('cacher') as opened:
        yield opened


def subscriptions(runtime: NodeRuntime) -> int:
    return runtime.call(lambda: len(list(runtime.node.subscriptions)))


def test_another_quality_of_service_is_another_subscription(runtime: NodeRuntime) -> None:
    caches = TopicCaches(runtime)
    publisher = runtime.call(lambda: runtime.node.create_publisher(String, 'selector', names.transient_local_qos()))
    publisher.publish(String(data='said before'))
    volatile = caches.cache(SubscribedTopic(String, 'selector'))
    latched = caches.cache(SubscribedTopic(String, 'selector', qos=names.transient_local_qos()))
    said = wait_until(lambda: latched.latest, 'what was said before')
    assert said.data == 'said before'
    assert volatile.latest is None
    assert caches.cache(SubscribedTopic(String, '/selector', qos=QoSProfile(depth=1))) is volatile
    best_effort = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)
    assert caches.cache(SubscribedTopic(String, 'selector', qos=best_effort)) is not volatile


def test_topics_that_no_tree_needs_are_not_kept(runtime: NodeRuntime, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr('flexbt_server.leaves.topic_cache.MOST_TOPICS', 10)
    before = subscriptions(runtime)
    caches = TopicCaches(runtime)
    held = caches.cache(SubscribedTopic(String, 'held'))
    for number in range(50):
        caches.cache(SubscribedTopic(String, f'topic{number}'))
    gc.collect()
    wait_until(lambda: subscriptions(runtime) == before + 11, lambda: f'{subscriptions(runtime)} subscriptions')
    publisher = runtime.call(lambda: runtime.node.create_publisher(String, 'held', 1))
    wait_until(publisher.get_subscription_count, 'the subscription in use')
    publisher.publish(String(data='heard'))
    wait_until(lambda: held.latest, 'a message')


def test_a_pose_with_far_too_much_in_it_is_left_aside(runtime: NodeRuntime) -> None:
    cache = TopicCaches(runtime).cache(SubscribedTopic(PoseStamped, 'pose', qos=10))
    publisher = runtime.call(lambda: runtime.node.create_publisher(PoseStamped, 'pose', 10))
    wait_until(publisher.get_subscription_count, 'the subscription')
    message = PoseStamped()
    message.header.frame_id = 'map'
    publisher.publish(message)
    wait_until(lambda: cache.latest, 'a pose')
    message.header.frame_id = 'x' * 3000
    publisher.publish(message)
    message.header.frame_id = 'odom'
    publisher.publish(message)
    wait_until(lambda: cache.latest == message, 'the last pose')


class Taker:
    def take(self) -> bool:
        return True


def test_services_that_no_tree_takes_are_not_kept(runtime: NodeRuntime, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr('flexbt_server.leaves.leaf_services.MOST_SERVICES', 10)
    triggers = TriggerServices(runtime)
    taker = Taker()
    triggers.offer('in_use', taker.take)
    for number in range(30):
        triggers.offer(f'service{number}', Taker().take)
    offered = [service.srv_name for service in runtime.node.services if '/service' in service.srv_name]
    assert offered == [f'/service{number}' for number in range(21, 30)]
    assert '/in_use' in [service.srv_name for service in runtime.node.services]


def test_a_condition_whose_topic_cannot_be_heard_says_why(tmp_path: Path) -> None:
    install_nodes(tmp_path, server_nodes.__name__)
    with NodeRuntime.open('door_sensor') as sensor, open_server_world() as world:
        sensor.call(lambda: sensor.node.create_publisher(Bool, 'door', qos_profile_sensor_data))
        world.client.load_tree('<DoorOpen/>')

        def reason() -> str:
            return str(world.client.execute().result.message)

        told = "no message yet. No messages on '/door' from /door_sensor: it publishes BEST_EFFORT, /bt_server"
        wait_until(lambda: told in reason(), reason)
