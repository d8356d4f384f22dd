# SPDX-License-Identifier: BSD-3-Clause
"""What nodes rely on, with rclpy alone: on DDS, and with the plugin on what stands in for it. Both must agree."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from contextlib import suppress
from itertools import product
from typing import Any

import pytest
import rclpy
from action_msgs.msg import GoalStatus
from lifecycle_msgs.srv import ChangeState, GetState
from nav2_msgs.action import Wait
from rcl_interfaces.srv import GetParameters, ListParameters
from rclpy.action import ActionClient, ActionServer, CancelResponse, GoalResponse
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.clock import Clock, ClockType
from rclpy.duration import Duration
from rclpy.event_handler import PublisherEventCallbacks, SubscriptionEventCallbacks
from rclpy.exceptions import InvalidHandle
from rclpy.executors import ExternalShutdownException, MultiThreadedExecutor
from rclpy.lifecycle import LifecycleNode, TransitionCallbackReturn
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.qos import DurabilityPolicy, LivelinessPolicy, QoSProfile, ReliabilityPolicy
from rclpy.signals import SignalHandlerOptions
from rosgraph_msgs.msg import Clock as ClockMessage
from std_msgs.msg import Float32, String
from std_srvs.srv import Trigger

from flexbt_testing.waiting import wait_until

RELIABLE, BEST_EFFORT = ReliabilityPolicy.RELIABLE, ReliabilityPolicy.BEST_EFFORT
LATCHED, VOLATILE = DurabilityPolicy.TRANSIENT_LOCAL, DurabilityPolicy.VOLATILE
AUTOMATIC, MANUAL = LivelinessPolicy.AUTOMATIC, LivelinessPolicy.MANUAL_BY_TOPIC


class Participant:
    """A node in a context of its own, which threads spin."""

    def __init__(self, name: str, node_class: type[Any] = Node, **options: Any) -> None:
        self.context = rclpy.Context()
        rclpy.init(context=self.context, args=[], signal_handler_options=SignalHandlerOptions.NO)
        self.node = node_class(name, context=self.context, **options)
        self._executor = MultiThreadedExecutor(3, context=self.context)
        self._executor.add_node(self.node)
        self._is_closed = False
        self._thread = threading.Thread(target=self._spin, name=name)
        self._thread.start()

    def _spin(self) -> None:
        with suppress(ExternalShutdownException):
            while not self._is_closed:
                self._executor.spin_once(timeout_sec=0.1)

    def close(self) -> None:
        self._is_closed = True
        self._thread.join()  # rclpy's executor may not be shut down while it spins
        self._executor.shutdown()
        self.node.destroy_node()
        rclpy.shutdown(context=self.context)


@pytest.fixture
def participants() -> Iterator[Callable[..., Any]]:
    """Yield a function that makes a node in a participant of its own."""
    made: list[Participant] = []

    def make(name: str, node_class: type[Any] = Node, **options: Any) -> Any:
        made.append(Participant(name, node_class, **options))
        return made[-1].node

    yield make
    for one in reversed(made):
        one.close()


def answer(future: Any) -> Any:
    wait_until(future.done, 'an answer')
    return future.result()


def test_the_same_profiles_match(participants: Callable[..., Any]) -> None:
    a, b = participants('a'), participants('b')
    offers = list(product((RELIABLE, BEST_EFFORT), (LATCHED, VOLATILE), (AUTOMATIC, MANUAL), (0.0, 1.0, 3.0)))
    told: list[tuple[int, str]] = []
    publishers = []
    pairs = [(offer, request) for offer in offers[:12] for request in offers]

    def profile(one: Any) -> QoSProfile:
        reliability, durability, liveliness, lease = one
        given = {'liveliness_lease_duration': Duration(seconds=lease)} if lease else {}
        return QoSProfile(depth=1, reliability=reliability, durability=durability, liveliness=liveliness, **given)

    for number, (offer, request) in enumerate(pairs):
        publishers.append(a.create_publisher(String, f'topic_{number}', profile(offer)))
        events = SubscriptionEventCallbacks(
            incompatible_qos=lambda event, number=number: told.append((number, str(int(event.last_policy_kind))))
        )
        b.create_subscription(String, f'topic_{number}', lambda _: None, profile(request), event_callbacks=events)

    def misfit(offer: Any, request: Any) -> bool:
        return bool(
            (offer[0], request[0]) == (BEST_EFFORT, RELIABLE)
            or (offer[1], request[1]) == (VOLATILE, LATCHED)
            or (offer[2], request[2]) == (AUTOMATIC, MANUAL)
            or (request[3] and not 0.0 < offer[3] <= request[3])
        )

    fitting = [not misfit(offer, request) for offer, request in pairs]
    wait_until(lambda: [one.get_subscription_count() == 1 for one in publishers] == fitting, 'the matches')
    wait_until(lambda: len(told) == fitting.count(False), lambda: f'{len(told)} of {fitting.count(False)} events')


def test_what_a_late_subscription_gets(participants: Callable[..., Any]) -> None:
    a, b = participants('a'), participants('b')
    publisher = a.create_publisher(String, 'topic', QoSProfile(depth=3, durability=LATCHED))
    for number in range(10):
        publisher.publish(String(data=str(number)))
    got: dict[int, list[str]] = {}
    for depth in (1, 2, 10):
        heard = got[depth] = []
        profile = QoSProfile(depth=depth, durability=LATCHED)
        b.create_subscription(String, 'topic', lambda message, heard=heard: heard.append(message.data), profile)
    volatile: list[str] = []
    b.create_subscription(String, 'topic', lambda message: volatile.append(message.data), 10)
    wait_until(lambda: got[10] == ['7', '8', '9'] and got[2][-1] == got[1][-1] == '9', lambda: got)
    wait_until(lambda: publisher.get_subscription_count() == 4, 'four subscriptions')
    publisher.publish(String(data='new'))
    wait_until(lambda: volatile == ['new'] and got[10][-1] == 'new', lambda: (volatile, got))


def test_lifespan_ends_what_is_kept(participants: Callable[..., Any]) -> None:
    a, b = participants('a'), participants('b')
    profile = QoSProfile(depth=10, durability=LATCHED, lifespan=Duration(seconds=0.5))
    publisher = a.create_publisher(String, 'topic', profile)
    publisher.publish(String(data='old'))
    clock = Clock(clock_type=ClockType.STEADY_TIME)
    began = clock.now()
    wait_until(lambda: clock.now() - began > Duration(seconds=2.0), 'the end of the lifespan')
    publisher.publish(String(data='new'))
    heard: list[str] = []
    b.create_subscription(
        String, 'topic', lambda message: heard.append(message.data), QoSProfile(depth=10, durability=LATCHED)
    )
    wait_until(lambda: heard, 'a message')
    assert heard == ['new']


def test_liveliness_is_lost_and_comes_back(participants: Callable[..., Any]) -> None:
    a, b = participants('a'), participants('b')
    profile = QoSProfile(depth=1, liveliness=MANUAL, liveliness_lease_duration=Duration(seconds=0.5))
    publisher = a.create_publisher(String, 'topic', profile)
    told: list[tuple[int, int]] = []
    events = SubscriptionEventCallbacks(
        liveliness=lambda event: told.append((event.alive_count, event.not_alive_count))
    )
    b.create_subscription(String, 'topic', lambda _: None, profile, event_callbacks=events)

    def is_alive_after(assert_it: Callable[[], Any]) -> bool:
        assert_it()  # again: what arrives before the subscription knows the publisher is lost, and a lease is short
        return told[-1] == (1, 0)

    wait_until(lambda: is_alive_after(publisher.assert_liveliness), lambda: told)
    wait_until(lambda: told[-1] == (0, 1), lambda: told)
    wait_until(lambda: is_alive_after(lambda: publisher.publish(String())), lambda: told)
    a.destroy_publisher(publisher)
    wait_until(lambda: told[-1] == (0, 0), lambda: told)


def test_both_sides_are_told_of_matches(participants: Callable[..., Any]) -> None:
    a, b = participants('a'), participants('b')
    of_publisher: list[Any] = []
    of_subscription: list[Any] = []

    def counts(event: Any) -> tuple[int, int]:
        return event.current_count, event.total_count

    publisher = a.create_publisher(
        String,
        'topic',
        1,
        event_callbacks=PublisherEventCallbacks(matched=lambda event: of_publisher.append(counts(event))),
    )
    events = SubscriptionEventCallbacks(matched=lambda event: of_subscription.append(counts(event)))
    first = b.create_subscription(String, 'topic', lambda _: None, 1, event_callbacks=events)
    wait_until(
        lambda: of_publisher == [(1, 1)] and of_subscription == [(1, 1)], lambda: (of_publisher, of_subscription)
    )
    b.destroy_subscription(first)
    wait_until(lambda: of_publisher[-1] == (0, 1), lambda: of_publisher)
    b.create_subscription(String, 'topic', lambda _: None, 1, event_callbacks=events)
    wait_until(lambda: of_publisher[-1] == (1, 2) and of_subscription[-1] == (1, 1), lambda: of_publisher)
    a.destroy_publisher(publisher)
    wait_until(lambda: of_subscription[-1] == (0, 1), lambda: of_subscription)


def test_messages_arrive_as_copies_in_order(participants: Callable[..., Any]) -> None:
    a, b = participants('a'), participants('b')
    publisher = a.create_publisher(Float32, 'topic', QoSProfile(depth=200))
    got: list[Any] = []
    b.create_subscription(Float32, 'topic', got.append, QoSProfile(depth=200))
    wait_until(lambda: publisher.get_subscription_count() == 1, 'the match')
    message = Float32()
    for number in range(100):
        message.data = 0.1 * number
        publisher.publish(message)
    wait_until(lambda: len(got) == 100, lambda: len(got))
    assert [round(one.data / 0.1) for one in got] == list(range(100))
    assert got[1].data != 0.1  # 32 bits
    assert got[1].data == pytest.approx(0.1, abs=1e-8)
    with pytest.raises(TypeError):
        publisher.publish(String())


def test_a_service_answers_each_client_once(participants: Callable[..., Any]) -> None:
    a, b, c = participants('a'), participants('b'), participants('c')

    def serve(_request: Any, response: Any) -> Any:
        response.message = 'served'
        return response

    clients = [node.create_client(Trigger, '/service') for node in (b, c)]
    assert not clients[0].service_is_ready()
    service = a.create_service(Trigger, 'service', serve)
    for client in clients:
        wait_until(client.service_is_ready, 'the service')
        assert [answer(client.call_async(Trigger.Request())).message for _ in range(3)] == ['served'] * 3
    a.destroy_service(service)
    wait_until(lambda: not clients[0].service_is_ready(), 'no service')


class Server:
    """An action server whose goals end when the test lets them."""

    def __init__(self, node: Any) -> None:
        self.goals: list[Any] = []
        self.may_end = threading.Event()
        self.server = ActionServer(
            node,
            Wait,
            'wait',
            self._execute,
            goal_callback=lambda request: GoalResponse.ACCEPT if request.time.sec else GoalResponse.REJECT,
            cancel_callback=lambda goal: CancelResponse.ACCEPT if goal.request.time.sec > 1 else CancelResponse.REJECT,
            callback_group=ReentrantCallbackGroup(),
        )

    def _execute(self, goal: Any) -> Any:
        self.goals.append(goal)
        goal.publish_feedback(Wait.Feedback())
        while not self.may_end.wait(0.01):
            if goal.is_cancel_requested:
                goal.canceled()
                return Wait.Result()
        if goal.is_cancel_requested:
            goal.canceled()
        else:
            goal.succeed()
        return Wait.Result()


def goal_of(seconds: int) -> Any:
    goal = Wait.Goal()
    goal.time.sec = seconds
    return goal


def test_goals_are_accepted_rejected_canceled_and_end(participants: Callable[..., Any]) -> None:
    a, b = participants('a'), participants('b')
    client = ActionClient(b, Wait, 'wait')
    assert not client.server_is_ready()
    server = Server(a)
    wait_until(client.server_is_ready, 'the server')
    assert not answer(client.send_goal_async(goal_of(0))).accepted
    feedback: list[Any] = []
    first = answer(client.send_goal_async(goal_of(2), feedback_callback=feedback.append))
    wait_until(lambda: first.status == GoalStatus.STATUS_EXECUTING, lambda: first.status)
    wait_until(lambda: feedback, 'feedback')
    second = answer(client.send_goal_async(goal_of(1)))
    assert answer(second.cancel_goal_async()).goals_canceling == []  # rejected
    assert len(answer(first.cancel_goal_async()).goals_canceling) == 1
    assert answer(first.get_result_async()).status == GoalStatus.STATUS_CANCELED
    server.may_end.set()
    assert answer(second.get_result_async()).status == GoalStatus.STATUS_SUCCEEDED
    ended = answer(second.cancel_goal_async())
    assert (ended.return_code, ended.goals_canceling) == (3, [])  # ERROR_GOAL_TERMINATED
    assert answer(second.get_result_async()).status == GoalStatus.STATUS_SUCCEEDED  # again
    server.server.destroy()
    client.destroy()


@pytest.mark.parametrize('number', range(5))
def test_a_goal_that_ends_while_it_is_canceled_ends_once(participants: Callable[..., Any], number: int) -> None:
    a, b = participants('a'), participants('b')
    server, client = Server(a), ActionClient(b, Wait, 'wait')
    wait_until(client.server_is_ready, 'the server')
    goal = answer(client.send_goal_async(goal_of(2)))
    result = goal.get_result_async()
    answers: list[Any] = []
    ends = (server.may_end.set, lambda: answers.append(goal.cancel_goal_async()))
    threads = [threading.Thread(target=end) for end in (ends if number % 2 else reversed(ends))]
    for thread in threads:
        thread.start()
    assert answer(result).status in (GoalStatus.STATUS_SUCCEEDED, GoalStatus.STATUS_CANCELED)
    for thread in threads:
        thread.join()
    answer(answers[0])  # rclpy's client may not be destroyed while it takes this
    server.server.destroy()
    client.destroy()


def test_parameters_are_served(participants: Callable[..., Any]) -> None:
    a, b = participants('a', parameter_overrides=[Parameter('speed', value=2.5)]), participants('b')
    a.declare_parameter('speed', 1.0)
    a.declare_parameter('name', 'robot')
    ask = b.create_client(GetParameters, '/a/get_parameters')
    wait_until(ask.service_is_ready, 'the service')
    values = answer(ask.call_async(GetParameters.Request(names=['speed', 'name', 'use_sim_time']))).values
    assert (values[0].double_value, values[1].string_value, values[2].bool_value) == (2.5, 'robot', False)
    lists = b.create_client(ListParameters, '/a/list_parameters')
    wait_until(lists.service_is_ready, 'the service')
    assert {'speed', 'name', 'use_sim_time'} <= set(answer(lists.call_async(ListParameters.Request())).result.names)


class Managed(LifecycleNode):
    """A managed node that cannot be activated."""

    def on_activate(self, state: Any) -> TransitionCallbackReturn:
        return TransitionCallbackReturn.FAILURE


def test_a_managed_node_goes_through_its_states(participants: Callable[..., Any]) -> None:
    participants('a', Managed)
    b = participants('b')
    change, ask = b.create_client(ChangeState, '/a/change_state'), b.create_client(GetState, '/a/get_state')
    wait_until(lambda: change.service_is_ready() and ask.service_is_ready(), 'the services')

    def go(number: int) -> tuple[bool, str]:
        request = ChangeState.Request()
        request.transition.id = number
        is_done = answer(change.call_async(request)).success
        return is_done, answer(ask.call_async(GetState.Request())).current_state.label

    assert go(1) == (True, 'inactive')
    assert go(3) == (False, 'inactive')
    assert go(2) == (True, 'unconfigured')
    assert go(5) == (True, 'finalized')


def test_the_graph_has_names_types_and_counts(participants: Callable[..., Any]) -> None:
    a, b = participants('a', namespace='/robot'), participants('b')
    publisher = a.create_publisher(String, 'words', 1)
    a.create_service(Trigger, '~/reset', lambda _, response: response)
    b.create_subscription(String, '/robot/words', lambda _: None, 1)
    wait_until(lambda: publisher.get_subscription_count() == 1, 'the match')
    wait_until(lambda: ('a', '/robot') in b.get_node_names_and_namespaces(), b.get_node_names_and_namespaces)
    assert ('/robot/words', ['std_msgs/msg/String']) in b.get_topic_names_and_types()
    wait_until(lambda: ('/robot/a/reset', ['std_srvs/srv/Trigger']) in b.get_service_names_and_types(), 'the service')
    assert b.count_publishers('/robot/words') == b.count_subscribers('/robot/words') == 1
    wait_until(lambda: b.get_publishers_info_by_topic('/robot/words')[0].node_name == 'a', 'the name of the node')
    info = b.get_publishers_info_by_topic('/robot/words')[0]
    assert (info.node_namespace, info.topic_type) == ('/robot', 'std_msgs/msg/String')
    assert info.qos_profile.reliability is RELIABLE
    own = a.get_publisher_names_and_types_by_node('a', '/robot')
    assert ('/robot/words', ['std_msgs/msg/String']) in own


def test_simulated_time_moves_timers_and_tells_jumps(participants: Callable[..., Any]) -> None:
    a = participants('a', parameter_overrides=[Parameter('use_sim_time', value=True)])
    b = participants('b')
    fired: list[float] = []
    a.create_timer(1.0, lambda: fired.append(a.get_clock().now().nanoseconds * 1e-9))
    clock = b.create_publisher(ClockMessage, '/clock', 10)
    wait_until(lambda: clock.get_subscription_count() == 1, 'the match')

    def publish(seconds: int) -> None:
        message = ClockMessage()
        message.clock.sec = seconds
        clock.publish(message)

    def is_told(seconds: int) -> bool:
        return bool(a.get_clock().now().nanoseconds == seconds * 10**9)

    def tick(seconds: int) -> None:
        publish(seconds)
        wait_until(lambda: is_told(seconds), f'the time {seconds}')

    def is_heard() -> bool:  # the subscription may know the publisher later than that knows the subscription
        publish(10)
        return is_told(10)

    wait_until(is_heard, 'the time 10')
    count = len(fired)
    tick(12)
    wait_until(lambda: len(fired) > count and fired[-1] == 12.0, lambda: fired)
    tick(12)
    tick(5)
    assert fired[-1] == 12.0
    tick(6)
    wait_until(lambda: fired[-1] == 6.0, lambda: fired)


def test_handles_end_once(participants: Callable[..., Any]) -> None:
    a = participants('a')
    publisher = a.create_publisher(String, 'topic', 1)
    a.destroy_publisher(publisher)
    with pytest.raises(InvalidHandle):
        publisher.publish(String())
    with pytest.raises(Exception, match='1invalid'):
        a.create_publisher(String, '1invalid', 1)
