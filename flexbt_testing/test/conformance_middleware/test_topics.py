# SPDX-License-Identifier: BSD-3-Clause
"""Topics: quality of service, events, what arrives, and what a late subscription gets."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Any

import pytest
import rclpy.logging
from geometry_msgs.msg import Point32, PoseStamped
from nav2_msgs.action import Wait
from rcl_interfaces.msg import Log
from rclpy.action import ActionClient
from rclpy.action.graph import get_action_client_names_and_types_by_node, get_action_names_and_types
from rclpy.duration import Duration, Infinite
from rclpy.event_handler import PublisherEventCallbacks, SubscriptionEventCallbacks
from rclpy.exceptions import InvalidNamespaceException, InvalidServiceNameException, InvalidTopicNameException
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.qos import (
    DurabilityPolicy,
    HistoryPolicy,
    LivelinessPolicy,
    QoSPolicyKind,
    QoSPresetProfiles,
    QoSProfile,
    ReliabilityPolicy,
)
from rclpy.serialization import deserialize_message, serialize_message
from sensor_msgs.msg import Imu, PointCloud
from std_msgs.msg import Int32, String, UInt8MultiArray
from std_srvs.srv import Empty

RELIABLE = QoSProfile(depth=10)
BEST_EFFORT = QoSProfile(depth=10, reliability=ReliabilityPolicy.BEST_EFFORT)
LATCHED = QoSProfile(depth=2, durability=DurabilityPolicy.TRANSIENT_LOCAL)
BEST_LATCHED = QoSProfile(
    depth=2, durability=DurabilityPolicy.TRANSIENT_LOCAL, reliability=ReliabilityPolicy.BEST_EFFORT
)
MANUAL = QoSProfile(
    depth=10, liveliness=LivelinessPolicy.MANUAL_BY_TOPIC, liveliness_lease_duration=Duration(seconds=1.0)
)


class Heard(list[int]):
    """The numbers that a subscription has received."""

    def __init__(self, node: Any, topic: str, qos: QoSProfile, **options: Any) -> None:
        super().__init__()
        self.subscription = node.create_subscription(
            Int32, topic, lambda message: self.append(message.data), qos, **options
        )


def pair(ros: Any, offered: QoSProfile = RELIABLE, requested: QoSProfile = RELIABLE) -> tuple[Any, Heard]:
    """Return a publisher and a subscription in two contexts, that have found each other."""
    publisher = ros.node('talker').create_publisher(Int32, ros.topic, offered)
    heard = Heard(ros.node('listener'), ros.topic, requested)
    ros.wait(publisher.get_subscription_count, 'a match')
    ros.wait(heard.subscription.get_publisher_count, 'a match')
    return publisher, heard


def test_messages_arrive_in_order(ros: Any) -> None:
    publisher, heard = pair(ros)
    for number in range(10):
        publisher.publish(Int32(data=number))
    ros.wait(lambda: heard == list(range(10)))


@pytest.mark.parametrize('offered', [RELIABLE, BEST_EFFORT], ids=['reliable', 'best_effort'])
def test_a_best_effort_subscription_hears_both(ros: Any, offered: QoSProfile) -> None:
    publisher, heard = pair(ros, offered, BEST_EFFORT)

    def is_heard() -> bool:
        publisher.publish(Int32(data=1))
        return bool(heard)

    ros.wait(is_heard)


@pytest.mark.parametrize('depth', [1, 3])
def test_a_queue_keeps_the_newest(ros: Any, depth: int) -> None:
    node = ros.node('listener', spins=False)
    heard = Heard(node, ros.topic, QoSProfile(depth=depth))
    publisher = ros.node('talker').create_publisher(Int32, ros.topic, RELIABLE)
    ros.wait(publisher.get_subscription_count)
    for number in range(6):
        publisher.publish(Int32(data=number))
    assert publisher.wait_for_all_acked(Duration(seconds=30.0))
    ros.spin(node)
    ros.wait(lambda: heard and heard[-1] == 5)
    assert heard == [0, 1, 2, 3, 4, 5][-depth:]


def test_keep_all_keeps_all(ros: Any) -> None:
    every = QoSProfile(history=HistoryPolicy.KEEP_ALL)
    node = ros.node('listener', spins=False)
    heard = Heard(node, ros.topic, every)
    publisher = ros.node('talker').create_publisher(Int32, ros.topic, every)
    ros.wait(publisher.get_subscription_count)
    for number in range(100):
        publisher.publish(Int32(data=number))
    ros.spin(node)
    ros.wait(lambda: heard == list(range(100)))


def test_a_late_subscription_gets_what_is_latched(ros: Any) -> None:
    publisher = ros.node('talker').create_publisher(Int32, ros.topic, LATCHED)
    for number in range(5):
        publisher.publish(Int32(data=number))
    listener = ros.node('listener')
    late, volatile = Heard(listener, ros.topic, LATCHED), Heard(listener, ros.topic, RELIABLE)
    ros.wait(lambda: len(late) == 2 and publisher.get_subscription_count() == 2)
    publisher.publish(Int32(data=5))
    ros.wait(lambda: late == [3, 4, 5] and volatile)
    assert volatile == [5]


@pytest.mark.parametrize('offered', [LATCHED, BEST_LATCHED], ids=['reliable', 'best_effort'])
def test_nothing_that_is_latched_is_sent_to_a_best_effort_subscription(ros: Any, offered: QoSProfile) -> None:
    publisher = ros.node('talker').create_publisher(Int32, ros.topic, offered)
    publisher.publish(Int32(data=1))
    heard = Heard(ros.node('listener'), ros.topic, BEST_LATCHED)

    def is_heard() -> bool:
        publisher.publish(Int32(data=2))
        return bool(heard)

    ros.wait(publisher.get_subscription_count)
    ros.wait(heard.subscription.get_publisher_count)
    ros.wait(is_heard)
    assert set(heard) == {2}


def test_a_latched_message_of_a_publisher_that_ended_is_gone(ros: Any) -> None:
    talker = ros.node('talker')
    ended, alive = (talker.create_publisher(Int32, ros.topic, LATCHED) for _ in range(2))
    ended.publish(Int32(data=1))
    alive.publish(Int32(data=2))
    talker.destroy_publisher(ended)
    heard = Heard(ros.node('listener'), ros.topic, LATCHED)
    ros.wait(lambda: heard)
    alive.publish(Int32(data=3))
    ros.wait(lambda: heard[-1] == 3)
    assert heard == [2, 3]


@pytest.mark.parametrize('of_subscription', [False, True], ids=['of publisher', 'of subscription'])
def test_what_waits_in_a_queue_ends_by_the_lifespan_of_the_subscription(ros: Any, of_subscription: bool) -> None:
    short = QoSProfile(depth=10, lifespan=Duration(seconds=2.0))
    offered, requested = (RELIABLE, short) if of_subscription else (short, RELIABLE)
    publisher = ros.node('talker').create_publisher(Int32, ros.topic, offered)
    listener = ros.node('listener', spins=False)
    heard = Heard(listener, ros.topic, requested)
    ros.wait(publisher.get_subscription_count)
    publisher.publish(Int32(data=1))
    assert publisher.wait_for_all_acked(Duration(seconds=30.0))
    end = time.monotonic() + 2.5
    ros.wait(lambda: time.monotonic() > end)
    ros.spin(listener)

    def is_heard() -> bool:
        publisher.publish(Int32(data=2))
        return 2 in heard

    ros.wait(is_heard)
    assert (1 in heard) == (not of_subscription)


def test_an_old_message_is_not_delivered(ros: Any) -> None:
    short = QoSProfile(depth=10, durability=DurabilityPolicy.TRANSIENT_LOCAL, lifespan=Duration(seconds=0.2))
    publisher = ros.node('talker').create_publisher(Int32, ros.topic, short)
    publisher.publish(Int32(data=1))
    end = time.monotonic() + 0.5
    ros.wait(lambda: time.monotonic() > end)
    heard = Heard(ros.node('listener'), ros.topic, LATCHED)
    ros.wait(publisher.get_subscription_count)

    def is_heard() -> bool:
        publisher.publish(Int32(data=2))
        return bool(heard)

    ros.wait(is_heard)
    assert 1 not in heard


LATCHED_OFTEN = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL, deadline=Duration(seconds=1.0))
MISFITS = {
    'reliability': (BEST_EFFORT, RELIABLE, QoSPolicyKind.RELIABILITY),
    'durability': (RELIABLE, LATCHED, QoSPolicyKind.DURABILITY),
    'deadline': (RELIABLE, QoSProfile(depth=1, deadline=Duration(seconds=1.0)), QoSPolicyKind.DEADLINE),
    'liveliness': (RELIABLE, MANUAL, QoSPolicyKind.LIVELINESS),
    'several': (RELIABLE, LATCHED_OFTEN, QoSPolicyKind.DEADLINE),
}


@pytest.mark.parametrize(('offered', 'requested', 'policy'), MISFITS.values(), ids=MISFITS)
def test_what_does_not_fit_is_told_to_both(
    ros: Any, offered: QoSProfile, requested: QoSProfile, policy: QoSPolicyKind
) -> None:
    told: dict[str, Any] = {}
    of_publisher = PublisherEventCallbacks(incompatible_qos=lambda event: told.update(offered=event))
    of_subscription = SubscriptionEventCallbacks(incompatible_qos=lambda event: told.update(requested=event))
    publisher = ros.node('talker').create_publisher(Int32, ros.topic, offered, event_callbacks=of_publisher)
    heard = Heard(ros.node('listener'), ros.topic, requested, event_callbacks=of_subscription)
    ros.wait(lambda: len(told) == 2)
    for event in told.values():
        assert (event.total_count, event.total_count_change, event.last_policy_kind) == (1, 1, policy)
    assert (publisher.get_subscription_count(), heard.subscription.get_publisher_count()) == (0, 0)


def test_matches_are_told_to_both(ros: Any) -> None:
    told: dict[str, list[tuple[int, int, int, int]]] = {'publisher': [], 'subscription': []}

    def tell(who: str) -> Any:
        def on_event(event: Any) -> None:
            if event.total_count_change or event.current_count_change:  # DDS may tell the same counts again
                told[who].append(
                    (event.total_count, event.total_count_change, event.current_count, event.current_count_change)
                )

        return on_event

    of_publisher = PublisherEventCallbacks(matched=tell('publisher'))
    talker, listener = ros.node('talker'), ros.node('listener')
    publisher = talker.create_publisher(Int32, ros.topic, RELIABLE, event_callbacks=of_publisher)
    heard = Heard(
        listener, ros.topic, RELIABLE, event_callbacks=SubscriptionEventCallbacks(matched=tell('subscription'))
    )
    ros.wait(lambda: all(told.values()))
    assert told == {'publisher': [(1, 1, 1, 1)], 'subscription': [(1, 1, 1, 1)]}
    listener.destroy_subscription(heard.subscription)
    ros.wait(lambda: len(told['publisher']) == 2)
    again = Heard(
        listener, ros.topic, RELIABLE, event_callbacks=SubscriptionEventCallbacks(matched=tell('subscription'))
    )
    ros.wait(lambda: len(told['publisher']) == 3 and len(told['subscription']) == 2)
    talker.destroy_publisher(publisher)
    ros.wait(lambda: len(told['subscription']) == 3)
    assert told['publisher'] == [(1, 1, 1, 1), (1, 0, 0, -1), (2, 1, 1, 1)]
    assert told['subscription'] == [(1, 1, 1, 1), (1, 1, 1, 1), (1, 0, 0, -1)]
    assert again.subscription.get_publisher_count() == 0


@pytest.mark.parametrize('how', ['publish', 'assert_liveliness'])
def test_a_lease_is_lost_and_regained(ros: Any, how: str) -> None:
    counts: list[tuple[int, int]] = []
    lost: list[int] = []
    publisher = ros.node('talker').create_publisher(
        Int32,
        ros.topic,
        MANUAL,
        event_callbacks=PublisherEventCallbacks(liveliness=lambda event: lost.append(event.total_count)),
    )
    events = SubscriptionEventCallbacks(
        liveliness=lambda event: counts.append((event.alive_count, event.not_alive_count))
    )
    heard = Heard(ros.node('listener'), ros.topic, MANUAL, event_callbacks=events)
    ros.wait(heard.subscription.get_publisher_count)

    def is_told_alive(since: int) -> bool:
        """Show life, again and again: on a busy machine a lease may end before its begin is told."""
        if how == 'publish':
            publisher.publish(Int32())
        else:
            publisher.assert_liveliness()
        return (1, 0) in counts[since:]

    ros.wait(lambda: is_told_alive(0))
    assert counts[0] == (1, 0)
    ros.wait(lambda: counts[-1] == (0, 1))
    ros.wait(lambda: lost)
    seen = len(counts)
    ros.wait(lambda: is_told_alive(seen))


def test_a_publisher_that_has_shown_no_life_is_neither_alive_nor_not(ros: Any) -> None:
    counts: list[tuple[int, int]] = []
    talker = ros.node('talker')
    publisher = talker.create_publisher(Int32, ros.topic, MANUAL)
    events = SubscriptionEventCallbacks(
        liveliness=lambda event: counts.append((event.alive_count, event.not_alive_count))
    )
    heard = Heard(ros.node('listener'), ros.topic, MANUAL, event_callbacks=events)
    ros.wait(heard.subscription.get_publisher_count)
    talker.destroy_publisher(publisher)
    ros.wait(lambda: not heard.subscription.get_publisher_count())
    assert not counts


def test_a_publisher_that_ends_is_neither_alive_nor_lost(ros: Any) -> None:
    counts: list[tuple[int, int]] = []
    slow = QoSProfile(depth=1, liveliness_lease_duration=Duration(seconds=3.0))
    talker = ros.node('talker')
    publisher = talker.create_publisher(Int32, ros.topic, slow)
    events = SubscriptionEventCallbacks(
        liveliness=lambda event: counts.append((event.alive_count, event.not_alive_count))
    )
    Heard(ros.node('listener'), ros.topic, slow, event_callbacks=events)
    ros.wait(lambda: (1, 0) in counts)
    talker.destroy_publisher(publisher)
    ros.wait(lambda: counts[-1] == (0, 0))


def test_each_subscription_has_its_own_lease(ros: Any) -> None:
    told: dict[str, list[tuple[int, int]]] = {'patient': [], 'without': []}
    lost: list[int] = []
    patient = QoSProfile(
        depth=10, liveliness=LivelinessPolicy.MANUAL_BY_TOPIC, liveliness_lease_duration=Duration(seconds=4.0)
    )
    publisher = ros.node('talker').create_publisher(
        Int32,
        ros.topic,
        MANUAL,
        event_callbacks=PublisherEventCallbacks(liveliness=lambda event: lost.append(event.total_count)),
    )
    heard = []
    for name, qos in (('patient', patient), ('without', RELIABLE)):

        def tell(event: Any, those: list[tuple[int, int]] = told[name]) -> None:
            those.append((event.alive_count, event.not_alive_count))

        events = SubscriptionEventCallbacks(liveliness=tell)
        heard.append(Heard(ros.node(name), ros.topic, qos, event_callbacks=events))
    ros.wait(lambda: publisher.get_subscription_count() == 2)
    ros.wait(lambda: all(one.subscription.get_publisher_count() for one in heard))
    publisher.publish(Int32())
    sent = time.monotonic()
    ros.wait(lambda: (1, 0) in told['patient'] and all(heard))
    ros.wait(lambda: lost)
    ros.wait(lambda: (0, 1) in told['patient'])
    assert time.monotonic() - sent > 3.0, 'the lease of the subscription'
    assert told['without'] == []


@pytest.mark.parametrize('qos', [RELIABLE, BEST_EFFORT, LATCHED, MANUAL])
def test_the_graph_tells_what_is_offered_and_what_is_meant_by_a_default(ros: Any, qos: QoSProfile) -> None:
    publisher, _ = pair(ros, qos, qos)
    observer = ros.node('observer')
    ros.wait(lambda: observer.count_publishers(publisher.topic_name), 'the publisher in the graph')
    (offered,) = observer.get_publishers_info_by_topic(publisher.topic_name)
    told = offered.qos_profile
    assert (told.reliability, told.durability) == (qos.reliability, qos.durability)
    assert told.liveliness == (LivelinessPolicy.MANUAL_BY_TOPIC if qos is MANUAL else LivelinessPolicy.AUTOMATIC)
    assert told.liveliness_lease_duration == (qos.liveliness_lease_duration if qos is MANUAL else Infinite)
    assert (told.history, told.depth, told.lifespan, told.deadline) == (HistoryPolicy.UNKNOWN, 0, Infinite, Infinite)


def test_the_graph_tells_the_endpoints_of_topics_and_services_by_their_names_in_dds(ros: Any) -> None:
    server, client, observer = (ros.node(name, namespace='/robot') for name in ('server', 'client', 'observer'))
    publisher = server.create_publisher(Int32, ros.topic, RELIABLE)
    service = observer.resolve_service_name(f'{ros.topic}/empty')
    server.create_service(Empty, service, lambda _request, response: response)
    client.create_client(Empty, service)
    request, reply = f'rq{service}Request', f'rr{service}Reply'

    def told(name: str) -> tuple[set[tuple[str, str, str]], ...]:
        looks = observer.get_publishers_info_by_topic, observer.get_subscriptions_info_by_topic
        found = [look(name, no_mangle=True) for look in looks]
        return tuple({(one.node_namespace, one.node_name, one.topic_type) for one in ends} for ends in found)

    request_type, reply_type = (f'std_srvs::srv::dds_::Empty_{part}_' for part in ('Request', 'Response'))
    for name, expected in {
        f'rt{publisher.topic_name}': ({('/robot', 'server', 'std_msgs::msg::dds_::Int32_')}, set()),
        request: ({('/robot', 'client', request_type)}, {('/robot', 'server', request_type)}),
        reply: ({('/robot', 'server', reply_type)}, {('/robot', 'client', reply_type)}),
    }.items():
        ros.wait(lambda name=name, expected=expected: told(name) == expected, f'{name} in the graph')
    replies, numbers = (
        observer.get_publishers_info_by_topic(name, no_mangle=True)[0] for name in (reply, f'rt{publisher.topic_name}')
    )
    assert bytes(replies.endpoint_gid)[:12] == bytes(numbers.endpoint_gid)[:12], 'they have one participant'
    assert replies.endpoint_gid != numbers.endpoint_gid
    for name in (publisher.topic_name, service, f'rr{service}', 'rr', 'xx/y'):
        assert told(name) == (set(), set()), name
    assert observer.get_publishers_info_by_topic(f'/rt{publisher.topic_name}') == []


def test_a_missed_deadline_is_told_to_both_from_the_first_message_on(ros: Any) -> None:
    told: dict[str, list[tuple[int, int]]] = {'offered': [], 'requested': []}
    periodic = QoSProfile(depth=10, deadline=Duration(seconds=0.3))

    def tell(who: str) -> Any:
        return lambda event: told[who].append((event.total_count, event.total_count_change))

    publisher = ros.node('talker').create_publisher(
        Int32, ros.topic, periodic, event_callbacks=PublisherEventCallbacks(deadline=tell('offered'))
    )
    events = SubscriptionEventCallbacks(deadline=tell('requested'))
    heard = Heard(ros.node('listener'), ros.topic, periodic, event_callbacks=events)
    ros.wait(publisher.get_subscription_count)
    end = time.monotonic() + 0.8
    ros.wait(lambda: time.monotonic() > end)
    assert told == {'offered': [], 'requested': []}
    publisher.publish(Int32())
    ros.wait(lambda: heard and all(those and those[-1][0] >= 2 for those in told.values()))
    assert all(sum(change for _, change in those) == those[-1][0] for those in told.values())


BEST = QoSPresetProfiles.BEST_AVAILABLE.value
BY_SYSTEM = QoSPresetProfiles.SYSTEM_DEFAULT.value
CHOICES = {
    'by the system': (BY_SYSTEM, BY_SYSTEM, 'RELIABLE TRANSIENT_LOCAL', 'BEST_EFFORT VOLATILE'),
    'best of latched': (LATCHED, BEST, 'RELIABLE TRANSIENT_LOCAL', 'RELIABLE TRANSIENT_LOCAL'),
    'best of best effort': (BEST_EFFORT, BEST, 'BEST_EFFORT VOLATILE', 'BEST_EFFORT VOLATILE'),
    'both best': (BEST, BEST, 'RELIABLE TRANSIENT_LOCAL', 'RELIABLE TRANSIENT_LOCAL'),
}


@pytest.mark.parametrize(('offered', 'requested', 'of_publisher', 'of_subscription'), CHOICES.values(), ids=CHOICES)
def test_what_is_left_to_others_is_chosen(
    ros: Any, offered: QoSProfile, requested: QoSProfile, of_publisher: str, of_subscription: str
) -> None:
    talker, listener = ros.node('talker'), ros.node('listener')
    publisher = talker.create_publisher(Int32, ros.topic, offered)
    publisher.publish(Int32(data=1))
    ros.wait(lambda: listener.count_publishers(ros.topic))
    heard = Heard(listener, ros.topic, requested)
    ros.wait(publisher.get_subscription_count)

    def is_heard() -> bool:
        publisher.publish(Int32(data=2))
        return 2 in heard

    is_late = 'TRANSIENT_LOCAL' in of_subscription
    ros.wait(lambda: heard or not is_late, 'what is latched')
    ros.wait(is_heard)
    assert (heard[0] == 1) == is_late
    told = (listener.get_publishers_info_by_topic(ros.topic), listener.get_subscriptions_info_by_topic(ros.topic))
    chosen = [f'{one.qos_profile.reliability.name} {one.qos_profile.durability.name}' for (one,) in told]
    assert chosen == [of_publisher, of_subscription]


def test_a_subscription_takes_the_longest_deadline_and_lease_that_is_offered(ros: Any) -> None:
    talker, listener = ros.node('talker'), ros.node('listener')
    for seconds in (1.0, 3.0):
        lease = Duration(seconds=2 * seconds)
        qos = QoSProfile(depth=1, deadline=Duration(seconds=seconds), liveliness_lease_duration=lease)
        talker.create_publisher(Int32, ros.topic, qos)
    ros.wait(lambda: listener.count_publishers(ros.topic) == 2)
    Heard(listener, ros.topic, BEST)
    ros.wait(lambda: listener.count_subscribers(ros.topic))
    (asked,) = listener.get_subscriptions_info_by_topic(ros.topic)
    assert asked.qos_profile.deadline == Duration(seconds=3.0)
    assert asked.qos_profile.liveliness_lease_duration == Duration(seconds=6.0)


def test_without_a_lease_nothing_is_told_of_liveliness(ros: Any) -> None:
    told: list[str] = []
    talker = ros.node('talker')
    publisher = talker.create_publisher(Int32, ros.topic, RELIABLE)
    events = SubscriptionEventCallbacks(
        liveliness=lambda _event: told.append('liveliness'), matched=lambda _event: told.append('matched')
    )
    heard = Heard(ros.node('listener'), ros.topic, RELIABLE, event_callbacks=events)
    ros.wait(publisher.get_subscription_count)
    publisher.publish(Int32())
    ros.wait(lambda: heard and told)
    assert 'liveliness' not in told


def test_receivers_have_copies(ros: Any) -> None:
    got: list[Any] = []
    publisher = ros.node('talker').create_publisher(PoseStamped, ros.topic, RELIABLE)
    listener = ros.node('listener')

    def change(message: Any) -> None:
        got.append(message)
        message.pose.position.x += 1.0

    for _ in range(2):
        listener.create_subscription(PoseStamped, ros.topic, change, RELIABLE)
    ros.wait(lambda: publisher.get_subscription_count() == 2)
    sent = PoseStamped()
    publisher.publish(sent)
    sent.pose.position.x = 10.0
    ros.wait(lambda: len(got) == 2)
    assert [message.pose.position.x for message in got] == [1.0, 1.0]


def _cloud() -> PointCloud:
    cloud = PointCloud(points=[Point32(x=0.1, y=1e30, z=-0.0)])
    cloud.header.frame_id = 'ä frame'
    return cloud


@pytest.mark.parametrize(
    'message',
    [
        String(data='line\nÄ\t'),
        UInt8MultiArray(data=bytes(range(256))),
        Imu(orientation_covariance=[0.1] * 9),
        _cloud(),
    ],
    ids=lambda message: type(message).__name__,
)
def test_values_arrive_as_they_were_serialized(ros: Any, message: Any) -> None:
    got: list[Any] = []
    publisher = ros.node('talker').create_publisher(type(message), ros.topic, RELIABLE)
    ros.node('listener').create_subscription(type(message), ros.topic, got.append, RELIABLE)
    ros.wait(publisher.get_subscription_count)
    publisher.publish(message)
    ros.wait(lambda: got)
    assert got[0] == deserialize_message(serialize_message(message), type(message))


def test_bytes_can_be_published_and_received(ros: Any) -> None:
    raw: list[bytes] = []
    got: list[int] = []
    publisher = ros.node('talker').create_publisher(Int32, ros.topic, RELIABLE)
    listener = ros.node('listener')
    listener.create_subscription(Int32, ros.topic, raw.append, RELIABLE, raw=True)
    listener.create_subscription(Int32, ros.topic, lambda message: got.append(message.data), RELIABLE)
    ros.wait(lambda: publisher.get_subscription_count() == 2)
    publisher.publish(serialize_message(Int32(data=7)))
    ros.wait(lambda: raw and got)
    assert got == [7]
    assert deserialize_message(raw[0], Int32) == Int32(data=7)


def test_bytes_that_are_no_message_are_dropped(ros: Any) -> None:
    got: list[str] = []
    publisher = ros.node('talker').create_publisher(String, ros.topic, RELIABLE)
    ros.node('listener').create_subscription(String, ros.topic, lambda message: got.append(message.data), RELIABLE)
    ros.wait(publisher.get_subscription_count)
    publisher.publish(bytes([0, 1, 0, 0, 255, 255, 255, 255]))
    publisher.publish(String(data='a text'))
    ros.wait(lambda: got == ['a text'])


def test_a_queue_has_a_depth_that_dds_can_count(ros: Any) -> None:
    with pytest.raises(rclpy_implementation.RCLError):
        ros.node('talker').create_publisher(Int32, ros.topic, QoSProfile(depth=-1))


def test_what_is_logged_is_on_a_topic_with_its_place(ros: Any) -> None:
    got: list[Log] = []
    ros.node('listener').create_subscription(Log, '/rosout', got.append, LATCHED)
    logger = ros.node(f'talker_{ros.topic}').get_logger()
    logger.info('a text')

    def own() -> list[Log]:
        return [one for one in got if one.name == logger.name]

    ros.wait(own)
    [line] = own()
    assert (line.msg, line.level, Path(line.file).name) == ('a text', 20, Path(__file__).name)
    assert line.function == 'test_what_is_logged_is_on_a_topic_with_its_place'
    assert line.line > 0


def test_only_a_child_of_the_logger_of_a_node_writes_to_its_topic(ros: Any) -> None:
    got: list[tuple[str, str]] = []
    node = ros.node(f'talker_{ros.topic}')
    name = node.get_logger().name
    heard = ros.node('listener').create_subscription(
        Log, '/rosout', lambda line: got.append((line.name, line.msg)) if line.name.startswith(name) else None, LATCHED
    )
    ros.wait(heard.get_publisher_count)
    rclpy.logging.get_logger(f'{name}.other').info('is not of the node')
    child = node.get_logger().get_child('part')
    child.get_child('of_part').info('a child of a child')
    child.info('a child')
    ros.wait(lambda: len(got) == 2)
    assert got == [(f'{name}.part.of_part', 'a child of a child'), (f'{name}.part', 'a child')]


def test_the_graph_names_what_is_only_called(ros: Any) -> None:
    node, observer = ros.node('caller'), ros.node('observer')
    kept = node.create_client(Empty, ros.topic), ActionClient(node, Wait, f'{ros.topic}_action')
    ros.wait(lambda: (f'/{ros.topic}', ['std_srvs/srv/Empty']) in observer.get_service_names_and_types())
    ros.wait(lambda: (f'/{ros.topic}_action', ['nav2_msgs/action/Wait']) in get_action_names_and_types(observer))
    assert observer.count_services(ros.topic) == 0
    with pytest.raises(rclpy_implementation.RCLError):
        get_action_client_names_and_types_by_node(observer, 'nobody', '/')
    assert kept


def test_a_callback_can_have_the_times_and_the_number_of_a_message(ros: Any) -> None:
    infos: list[dict[str, Any]] = []
    publisher = ros.node('talker').create_publisher(Int32, ros.topic, RELIABLE)
    node = ros.node('listener', spins=False)
    node.create_subscription(Int32, ros.topic, lambda _message, info: infos.append(info), RELIABLE)
    ros.wait(publisher.get_subscription_count)
    before = time.time_ns()
    publisher.publish(Int32())
    assert publisher.wait_for_all_acked(Duration(seconds=30.0))
    arrived = time.time_ns()
    ros.spin(node)
    ros.wait(lambda: infos)
    assert before <= infos[0]['source_timestamp'] <= infos[0]['received_timestamp'] <= arrived
    publisher.publish(Int32())
    ros.wait(lambda: len(infos) == 2)
    assert [info['publication_sequence_number'] for info in infos] == [1, 2]


def test_a_node_hears_itself_and_others_of_its_context(ros: Any) -> None:
    context = ros.context()
    node, other = ros.node('one', context=context), ros.node('other', context=context)
    own, others = Heard(node, ros.topic, RELIABLE), Heard(other, ros.topic, RELIABLE)
    publisher = node.create_publisher(Int32, ros.topic, RELIABLE)
    ros.wait(lambda: publisher.get_subscription_count() == 2)
    publisher.publish(Int32(data=3))
    ros.wait(lambda: own == others == [3])


def test_a_wrong_message_is_refused(ros: Any) -> None:
    publisher = ros.node('talker').create_publisher(Int32, ros.topic, RELIABLE)
    with pytest.raises(TypeError):
        publisher.publish(String())


@pytest.mark.parametrize('name', ['a b', '7', 'a//b', ''])
def test_an_invalid_name_is_refused(ros: Any, name: str) -> None:
    node = ros.node('talker')
    with pytest.raises(InvalidTopicNameException):
        node.create_subscription(Int32, name, print, RELIABLE)
    with pytest.raises(InvalidTopicNameException):
        node.create_publisher(Int32, name, RELIABLE)
    with pytest.raises(InvalidServiceNameException):
        node.create_service(Empty, name, print)
    with pytest.raises(RuntimeError, match='failed to resolve name'):
        node.resolve_topic_name(name)


@pytest.mark.parametrize('namespace', ['//x', '/x/', '/1'])
def test_an_invalid_namespace_is_refused(ros: Any, namespace: str) -> None:
    with pytest.raises(InvalidNamespaceException):
        ros.node('talker', namespace=namespace)


def test_what_is_destroyed_cannot_be_used(ros: Any) -> None:
    node = ros.node('talker')
    publisher = node.create_publisher(Int32, ros.topic, RELIABLE)
    assert node.destroy_publisher(publisher)
    assert not node.destroy_publisher(publisher)
    publisher.destroy()
    with pytest.raises(Exception, match='destruction was requested'):
        publisher.publish(Int32())


@pytest.mark.parametrize(
    ('own', 'of_all', 'name'),
    [
        ((), ('__node:=b', '__ns:=/y'), '/y/b'),
        (('__ns:=/x',), ('__node:=b', '__ns:=/y'), '/x/b'),
        (('a:__node:=a', 'a:__ns:=/x'), ('__node:=b', '__ns:=/y'), '/x/a'),
        (('a:__node:=b', 'a:__ns:=/x', 'b:__ns:=/z'), (), '/z/b'),
        (('__node:=b', '__node:=c', 'b:__node:=d'), (), '/b'),
    ],
)
def test_the_first_rule_that_is_meant_for_a_node_names_it(
    ros: Any, own: tuple[str, ...], of_all: tuple[str, ...], name: str
) -> None:
    rules, context = (['--ros-args', *(word for rule in given for word in ('-r', rule))] for given in (own, of_all))
    node = ros.node('a', context=ros.context(context), cli_args=rules, spins=False)
    assert node.get_fully_qualified_name() == name


@pytest.mark.parametrize('is_of_node', [False, True], ids=['of all', 'of a node'])
@pytest.mark.parametrize(
    ('words', 'topic', 'service'),
    [
        ('--ros-args -r rostopic://chatter:=a', '/x/a', '/x/chatter'),
        ('--ros-args -r own:rosservice://chatter:=b -r other:rostopic://chatter:=c', '/x/chatter', '/x/b'),
        ('--ros-args -r rostopic:///x/chatter:=~/a -r chatter:=/b', '/x/own/a', '/b'),
        ('chatter:=a', '/x/a', '/x/a'),  # as in ROS 2 Dashing
        ('--word own:chatter:=a --ros-args -r chatter:=b -- -r', '/x/a', '/x/a'),
        ('-r chatter:=1 -r', '/x/chatter', '/x/chatter'),
    ],
)
def test_a_rule_is_for_topics_or_services_or_both(
    ros: Any, words: str, topic: str, service: str, is_of_node: bool
) -> None:
    context = ros.context([] if is_of_node else words.split())
    given = words.split() if is_of_node else None
    node = ros.node('own', namespace='/x', context=context, cli_args=given, spins=False)
    assert node.create_publisher(Int32, 'chatter', 1).topic_name == topic
    assert node.create_service(Empty, 'chatter', print).service_name == service
    assert (node.resolve_topic_name('chatter'), node.resolve_service_name('chatter')) == (topic, service)
