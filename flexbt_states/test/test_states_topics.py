# SPDX-License-Identifier: BSD-3-Clause
"""The states that publish and that wait for messages."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from types import SimpleNamespace
from typing import Any

import pytest
from geometry_msgs.msg import Point
from rclpy.qos import QoSProfile, qos_profile_sensor_data
from std_msgs.msg import String

from flexbt_common import names
from flexbt_common.runtime.node_runtime import NodeRuntime, qos_misfit
from flexbt_core.state_machine.authoring.machine import OperatableStateMachine
from flexbt_core.state_machine.model.event_state import EventState
from flexbt_states import PublishOnceState, SubscribeOnceState, SubscriberState, WaitState, topic_states
from flexbt_states.errors import StateParameterError
from flexbt_states.topic_states import StateSubscription
from flexbt_testing.nodes.state_bench import StateBench
from flexbt_testing.waiting import DEADLINE, wait_until


class Peer:
    """Another node that publishes and listens."""

    def __init__(self) -> None:
        self.runtime = NodeRuntime('peer', args=())
        self.received: list[Any] = []

    def publisher(self, topic: str, qos: QoSProfile | int = 10) -> Any:
        return self.runtime.call(lambda: self.runtime.node.create_publisher(String, topic, qos))

    def listen(self, topic: str, qos: QoSProfile | int = 10) -> Any:
        return self.runtime.call(
            lambda: self.runtime.node.create_subscription(String, topic, self.received.append, qos)
        )


@pytest.fixture
def peer() -> Iterator[Peer]:
    peer = Peer()
    yield peer
    peer.runtime.close()


def test_the_next_message_is_received(bench: StateBench, peer: Peer) -> None:
    publisher = peer.publisher('speech')
    read: dict[str, Any] = {}
    run = bench.run_state(
        lambda: SubscribeOnceState('speech', 'std_msgs/msg/String'), {'message': None}, outputs=['message'], read=read
    )
    wait_until(publisher.get_subscription_count, 'subscribed')
    publisher.publish(String(data='hello'))
    assert run.wait() == 'received'
    assert read == {'message': String(data='hello')}
    wait_until(lambda: publisher.get_subscription_count() == 0, 'unsubscribed')


class Interrupted:
    """A lock that another thread takes just before this one."""

    def __init__(self, between: Callable[[], object]) -> None:
        self.between: Callable[[], object] | None = between

    def __enter__(self) -> None:
        between, self.between = self.between, None
        if between is not None:
            between()

    def __exit__(self, *_: object) -> None:
        pass


def test_a_message_that_arrives_while_the_state_is_left_is_none_of_its_next_visit(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    receivers: list[Callable[[String], None]] = []
    node = SimpleNamespace(
        create_subscription=lambda type, topic, receive, qos: receivers.append(receive),
        destroy_subscription=lambda subscription: None,
    )
    runtime = SimpleNamespace(node=node, post=lambda fn: fn())
    monkeypatch.setattr(topic_states, 'state_services', lambda state: SimpleNamespace(runtime=runtime))
    subscription = StateSubscription(EventState(outcomes=['done']), 'speech', String, QoSProfile(depth=1))
    subscription.open()

    def leave_and_enter() -> None:
        subscription.close()
        subscription.open()

    monkeypatch.setattr(subscription, '_lock', Interrupted(leave_and_enter))
    receivers[0](String(data='late'))
    assert subscription.take() is None
    receivers[1](String(data='new'))
    assert subscription.take() == String(data='new')


def test_a_topic_of_another_type_is_a_fault_of_the_state(bench: StateBench) -> None:
    bench.runtime.call(lambda: bench.runtime.node.create_publisher(Point, 'places', 1))
    run = bench.run_state(lambda: SubscribeOnceState('places', 'std_msgs/msg/String'))
    assert run.wait() == 'error'
    assert 'geometry_msgs/msg/Point' in run.errors()


def test_without_a_message_in_time_the_outcome_is_timeout(bench: StateBench) -> None:
    run = bench.run_state(lambda: SubscribeOnceState('speech', String, timeout=0.1), {'message': None})
    assert run.wait() == 'timeout'
    assert 'speech' in run.errors()


def test_a_latched_message_counts_when_asked_for(bench: StateBench, peer: Peer) -> None:
    peer.publisher('map_name', names.transient_local_qos()).publish(String(data='office'))
    read: dict[str, Any] = {}
    run = bench.run_state(
        lambda: SubscribeOnceState('map_name', String, latched=True), {'message': None}, outputs=['message'], read=read
    )
    run.wait()
    assert read == {'message': String(data='office')}


@pytest.mark.parametrize('make', [SubscribeOnceState, SubscriberState])
def test_a_sensor_that_is_not_heard_is_shown_with_what_to_do(bench: StateBench, peer: Peer, make: Any) -> None:
    peer.publisher('scan', qos_profile_sensor_data)
    run = bench.run_state(lambda: make('scan', String), {'message': None})

    def shown() -> str:
        return ' '.join(line for leaf in run.active() for line in leaf.activity)

    wait_until(lambda: 'from /peer: it publishes BEST_EFFORT, /bench_executive subscribes RELIABLE. ' in shown(), shown)


def test_a_sensor_that_is_not_heard_is_the_reason_of_the_timeout(bench: StateBench, peer: Peer) -> None:
    peer.publisher('scan', qos_profile_sensor_data)
    node = bench.runtime.node
    bench.runtime.call(lambda: node.create_subscription(String, 'scan', lambda _: None, 1))
    wait_until(lambda: 'from /peer' in qos_misfit(bench.runtime, '/scan'), 'what is wrong')
    run = bench.run_state(lambda: SubscribeOnceState('scan', String, timeout=0.1), {'message': None})
    assert run.wait() == 'timeout'
    assert "on scan within 0.1 s. No messages on '/scan' from /peer: it publishes BEST_EFFORT" in run.errors()


def test_a_sensor_is_heard_when_asked_for(bench: StateBench, peer: Peer) -> None:
    """A reader that wants reliability is not matched with a writer of best effort, and would wait for ever."""
    publisher = peer.publisher('scan', qos_profile_sensor_data)
    run = bench.run_state(lambda: SubscribeOnceState('scan', String, best_effort=True), {'message': None})
    wait_until(publisher.get_subscription_count, 'subscribed')

    def say_until_heard() -> bool:
        publisher.publish(String(data='wall'))  # any of them may be lost
        return publisher.get_subscription_count() == 0

    wait_until(say_until_heard, 'heard')
    assert run.wait() == 'received'


def test_a_stop_while_waiting_ends_the_subscription(bench: StateBench, peer: Peer) -> None:
    publisher = peer.publisher('speech')
    run = bench.run_state(lambda: SubscribeOnceState('speech', String), {'message': None})
    wait_until(publisher.get_subscription_count, 'subscribed')
    assert run.stop() == 'preempted'
    wait_until(lambda: publisher.get_subscription_count() == 0, 'unsubscribed')


@pytest.mark.parametrize(('blocking', 'clear', 'outcome'), [(False, False, 'received'), (False, True, 'unavailable')])
def test_subscriber_state_takes_what_came_before_unless_told_to_clear(
    bench: StateBench, peer: Peer, blocking: bool, clear: bool, outcome: str
) -> None:
    publisher = peer.publisher('speech')
    go = peer.publisher('go')

    def machine() -> OperatableStateMachine:
        root = OperatableStateMachine(outcomes=['received', 'unavailable', 'late'])
        root.userdata.message = None
        with root:
            ends = {'received': 'received', 'unavailable': 'unavailable'}
            start = SubscribeOnceState('go', String)
            OperatableStateMachine.add('Go', start, {'received': 'Take', 'timeout': 'late'})
            OperatableStateMachine.add('Take', SubscriberState('speech', String, blocking, clear), ends)
        return root

    run = bench.run(machine)
    wait_until(lambda: publisher.get_subscription_count() and go.get_subscription_count(), 'both subscribed')
    for number in range(3):
        publisher.publish(String(data=str(number)))
    publisher.wait_for_all_acked()
    # Delivered to the reader by now, but perhaps not called back: the next message is on another subscription.
    done = threading.Event()
    bench.runtime.steady.call_at(bench.runtime.steady.now() + 0.1, done.set)
    done.wait(DEADLINE)
    go.publish(String())
    assert run.wait() == outcome


def test_publish_once_reaches_who_listens(bench: StateBench, peer: Peer) -> None:
    peer.listen('words', names.transient_local_qos())

    def machine() -> OperatableStateMachine:
        root = OperatableStateMachine(outcomes=['done'])
        root.userdata.message = String(data='hello')
        with root:
            OperatableStateMachine.add(
                'Publish', PublishOnceState('words', 'std_msgs/String', latched=True), {'done': 'Wait'}
            )
            OperatableStateMachine.add('Wait', WaitState(60.0), {'done': 'done'})
        return root

    run = bench.run(machine)
    wait_until(lambda: String(data='hello') in peer.received, 'message received')
    assert run.stop() == 'preempted'


def test_a_value_of_another_type_is_a_fault(bench: StateBench) -> None:
    run = bench.run_state(lambda: PublishOnceState('words', String), {'message': Point()})
    assert run.wait() == 'error'
    assert 'expected a std_msgs/msg/String' in run.errors() + run.message


@pytest.mark.parametrize(
    'make',
    [
        lambda: SubscribeOnceState('two words', String),
        lambda: SubscribeOnceState('topic', 'std_msgs/msg/Strin'),
        lambda: SubscribeOnceState('topic', 'string'),
        lambda: SubscribeOnceState('topic', 'std_msgs/msg/String[]'),
        lambda: SubscribeOnceState('topic', String, timeout=0),
        lambda: SubscriberState('topic', 7),  # type: ignore[arg-type]
        lambda: PublishOnceState('', String),
    ],
)
def test_what_cannot_work_is_refused_when_the_state_is_made(make: Any) -> None:
    with pytest.raises(StateParameterError):
        make()
