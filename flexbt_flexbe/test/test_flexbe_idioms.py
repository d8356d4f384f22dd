# SPDX-License-Identifier: BSD-3-Clause
"""What states of users write for ROS beside FlexBE's proxies: rclpy's own idioms, in the process of the executive."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import pytest
import rclpy
from rclpy.action import ActionClient
from rclpy.duration import Duration
from rclpy.executors import Executor, MultiThreadedExecutor, SingleThreadedExecutor
from rclpy.node import Node
from rclpy.qos import QoSProfile
from rclpy.time import Time
from rclpy.wait_for_message import wait_for_message
from std_msgs.msg import String
from std_srvs.srv import Trigger

from flexbt_common.middleware.implementation import CYCLONE_DDS, implementation
from flexbt_common.runtime.node_runtime import NodeRuntime
from flexbt_flexbe import EventState, Logger, ProxySubscriberCached
from flexbt_msgs.action import BtExecute
from flexbt_onboard.behaviors.run_context import building
from flexbt_testing.nodes.scripted_action_server import ends
from flexbt_testing.nodes.state_bench import StateBench
from flexbt_testing.waiting import DEADLINE, wait_until

LATCHED = QoSProfile(depth=1, durability=rclpy.qos.DurabilityPolicy.TRANSIENT_LOCAL)


class Code(EventState):
    """A state whose ``execute`` is what a test wants to try; its outcome tells whether that gave true."""

    def __init__(self, code: Callable[[Any], object]) -> None:
        super().__init__(outcomes=['done', 'failed'])
        self._code = code

    def execute(self, userdata: Any) -> str:
        return 'done' if self._code(self) else 'failed'


@contextmanager
def robot() -> Iterator[None]:
    """Another node, with a service, and a word that is kept for who comes later."""

    def answer(_request: Any, response: Any) -> Any:
        response.success = True
        return response

    with NodeRuntime.open('robot') as runtime:
        runtime.call(lambda: runtime.node.create_service(Trigger, 'look', answer))
        publisher = runtime.call(lambda: runtime.node.create_publisher(String, 'words', LATCHED))
        publisher.publish(String(data='hello'))
        yield


class Commander(Node):
    """Made as BasicNavigator of nav2_simple_commander: a node of its own, which waits by rclpy's functions."""

    def __init__(self) -> None:
        super().__init__('commander')
        self.words: list[str] = []
        self.create_subscription(String, 'words', lambda message: self.words.append(message.data), LATCHED)
        self.execute_client = ActionClient(self, BtExecute, 'commanded')

    def go(self) -> bool:
        while not self.execute_client.wait_for_server(timeout_sec=1.0):
            self.get_logger().info('waits')
        sent = self.execute_client.send_goal_async(BtExecute.Goal())
        rclpy.spin_until_future_complete(self, sent)
        result = sent.result().get_result_async()
        while not result.done():
            rclpy.spin_until_future_complete(self, result, timeout_sec=0.1)
        return bool(result.result().result.message == 'there')


def looks(client: Any) -> Any:
    while not client.wait_for_service(timeout_sec=1.0):
        pass
    return client.call_async(Trigger.Request())


def ok_ends_no_loop(state: Any) -> bool:
    rounds = 0
    while rclpy.ok() and rounds < 3:
        rounds += 1
    return rounds == 3


def a_node_of_its_own(state: Any) -> bool:
    node = rclpy.create_node('helper')
    future = looks(node.create_client(Trigger, 'look'))
    while rclpy.ok() and not future.done():
        rclpy.spin_once(node, timeout_sec=0.1)
    node.destroy_node()
    return bool(future.result().success)


def a_commander(state: Any) -> bool:
    commander = Commander()
    try:
        return commander.go()
    finally:
        commander.destroy_node()


def the_future_of_a_service(state: Any) -> bool:
    future = looks(state._node.create_client(Trigger, 'look'))
    rclpy.spin_until_future_complete(state._node, future)
    return bool(future.result().success)


def a_future_that_stays_open(state: Any) -> bool:
    future = state._node.create_client(Trigger, 'nobody_serves_it').call_async(Trigger.Request())
    rclpy.spin_until_future_complete(state._node, future, timeout_sec=0.2)
    return not future.done()


def a_loop_that_spins_the_node(state: Any) -> bool:
    words: list[Any] = []
    state._node.create_subscription(String, 'words', words.append, LATCHED)
    while not words:
        rclpy.spin_once(state._node)
    return True


def a_loop_that_spins_with_a_limit(state: Any) -> bool:
    words: list[Any] = []
    state._node.create_subscription(String, 'words', words.append, LATCHED)
    while rclpy.ok() and not words:
        rclpy.spin_once(state._node, timeout_sec=0.1)
    return True


def a_call_that_blocks(state: Any) -> bool:
    client = state._node.create_client(Trigger, 'look')
    client.wait_for_service()
    return bool(client.call(Trigger.Request()).success)


def a_goal(state: Any) -> bool:
    client = ActionClient(state._node, BtExecute, 'commanded')
    client.wait_for_server()
    sent = client.send_goal_async(BtExecute.Goal())
    rclpy.spin_until_future_complete(state._node, sent)
    result = sent.result().get_result_async()
    rclpy.spin_until_future_complete(state._node, result)
    client.destroy()
    return bool(result.result().result.message == 'there')


def a_rate(state: Any) -> bool:
    rate = state._node.create_rate(100)
    rate.sleep()
    state._node.destroy_rate(rate)
    return True


def sleep_on_the_clock(state: Any) -> bool:
    return bool(state._node.get_clock().sleep_for(Duration(seconds=0.01)))


def a_timer(state: Any) -> bool:
    rung = threading.Event()
    timer = state._node.create_timer(0.01, rung.set)
    is_rung = rung.wait(DEADLINE)
    state._node.destroy_timer(timer)
    return is_rung


def times(state: Any) -> bool:
    now = state._node.get_clock().now()
    return bool(
        Time.from_msg(now.to_msg(), clock_type=now.clock_type) == now
        and (now - Time(seconds=1, clock_type=now.clock_type)) > Duration(seconds=1)
    )


def parameters(state: Any) -> bool:
    if not state._node.has_parameter('speed'):
        state._node.declare_parameter('speed', 0.5)
    return bool(state._node.get_parameter('speed').value == 0.5)


def spinning(executor: Executor, node: Any) -> bool:
    executor.add_node(node)
    thread = threading.Thread(target=executor.spin, daemon=True)
    thread.start()
    future = looks(node.create_client(Trigger, 'look'))
    done = threading.Event()
    future.add_done_callback(lambda _: done.set())
    is_done = done.wait(DEADLINE)
    executor.shutdown()
    thread.join(DEADLINE)
    return is_done and not thread.is_alive()


def an_executor_in_a_thread(state: Any) -> bool:
    node = rclpy.create_node('threaded')
    try:
        return spinning(SingleThreadedExecutor(), node)
    finally:
        node.destroy_node()


def an_executor_in_a_thread_for_the_node(state: Any) -> bool:
    """As that of a TransformListener with spin_thread=True."""
    own = state._node.executor
    return spinning(SingleThreadedExecutor(), state._node) and state._node.executor is own


def several_threads_for_the_node(state: Any) -> bool:
    return spinning(MultiThreadedExecutor(2), state._node)


def the_next_message(state: Any) -> bool:
    found, message = wait_for_message(String, state._node, 'words', qos_profile=LATCHED, time_to_wait=DEADLINE)
    return bool(found and message.data == 'hello')


def initialized_if_need_be(state: Any) -> bool:
    if not rclpy.ok():
        rclpy.init()
    return rclpy.get_default_context().ok()


def a_callback_that_uses_the_node_and_logs(state: Any) -> bool:
    heard = threading.Event()

    def hear(message: Any) -> None:
        Logger.loginfo('heard %s', message.data)
        state._node.get_logger().info('heard')
        Code._node.get_clock().now()
        heard.set()

    subscription = state._node.create_subscription(String, 'words', hear, LATCHED)
    is_heard = heard.wait(DEADLINE)
    state._node.destroy_subscription(subscription)
    return is_heard


def a_callback_that_awaits_an_answer(state: Any) -> bool:
    """In rclpy's group of a node, its answer would wait for the callback, and all that the executive hears with it."""
    client = state._node.create_client(Trigger, 'look')
    looks(client)
    answered = threading.Event()

    async def hear(_message: Any) -> None:
        if (await client.call_async(Trigger.Request())).success:
            answered.set()

    subscription = state._node.create_subscription(String, 'words', hear, LATCHED)
    is_answered = answered.wait(DEADLINE)
    state._node.destroy_subscription(subscription)
    return is_answered


def a_thread_that_uses_proxies_and_logs(state: Any) -> bool:
    found: list[object] = []

    def work() -> None:
        Logger.loginfo('works')
        words = ProxySubscriberCached({'words': String}, qos=LATCHED)
        found.append(wait_until(lambda: words.get_last_msg('words'), 'a word'))

    thread = threading.Thread(target=work)
    thread.start()
    thread.join()
    return bool(found)


IDIOMS = (
    a_callback_that_uses_the_node_and_logs,
    a_callback_that_awaits_an_answer,
    a_thread_that_uses_proxies_and_logs,
    ok_ends_no_loop,
    a_node_of_its_own,
    a_commander,
    the_future_of_a_service,
    a_future_that_stays_open,
    a_loop_that_spins_the_node,
    a_loop_that_spins_with_a_limit,
    a_call_that_blocks,
    a_goal,
    a_rate,
    sleep_on_the_clock,
    a_timer,
    times,
    parameters,
    an_executor_in_a_thread,
    an_executor_in_a_thread_for_the_node,
    several_threads_for_the_node,
    the_next_message,
    initialized_if_need_be,
)


@pytest.mark.parametrize('code', IDIOMS, ids=lambda code: code.__name__)
def test_the_idiom_works_twice_and_the_node_is_spun_as_before(bench: StateBench, code: Callable[[Any], object]) -> None:
    with robot():
        bench.serve(BtExecute, 'commanded', ends(BtExecute.Result(message='there')))
        for _ in range(2):
            run = bench.run_state(lambda: Code(code))
            assert (run.wait(), run.errors()) == ('done', '')
        assert bench.run_state(lambda: Code(the_future_of_a_service)).wait() == 'done'


def test_a_state_that_shuts_rclpy_down_ends_neither_the_node_nor_the_next_run(bench: StateBench) -> None:
    def shut_down(_state: Any) -> bool:
        rclpy.shutdown()
        return not rclpy.ok()

    with robot():
        assert bench.run_state(lambda: Code(shut_down)).wait() == 'done'
        assert bench.run_state(lambda: Code(a_node_of_its_own)).wait() == 'done'


def test_a_callback_of_the_node_that_spins_it_is_told_what_to_write(bench: StateBench) -> None:
    told: list[str] = []

    def from_a_callback(state: Any) -> bool:
        done = threading.Event()

        def hear(_message: Any) -> None:
            try:
                rclpy.spin_once(state._node)
            except RuntimeError as error:
                told.append(str(error))
            done.set()

        state._node.create_subscription(String, 'words', hear, LATCHED)
        return done.wait(DEADLINE)

    with robot():
        run = bench.run_state(lambda: Code(from_a_callback))
        assert (run.wait(), run.errors()) == ('done', '')
        assert bench.run_state(lambda: Code(the_future_of_a_service)).wait() == 'done'
    assert 'a callback of node /bench_executive cannot spin this node' in told[0]
    assert 'future.add_done_callback' in told[0]


def test_nodes_that_are_left_end_with_the_executive() -> None:
    with StateBench() as bench:
        assert bench.run_state(lambda: Code(lambda _: rclpy.create_node('left_behind'))).wait() == 'done'
    assert not rclpy.ok()
    with NodeRuntime.open('observer') as runtime:
        assert 'left_behind' not in runtime.call(runtime.node.get_node_names)


def test_where_behaviors_are_only_built_nodes_of_users_are_alone() -> None:
    with NodeRuntime.open('robot'), building():
        node = rclpy.create_node('helper')
        assert implementation() == CYCLONE_DDS or node.get_node_names() == ['helper']
    assert not rclpy.ok()
