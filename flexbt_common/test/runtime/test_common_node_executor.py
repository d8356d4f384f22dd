# SPDX-License-Identifier: BSD-3-Clause
"""The executor of a node: everything that rclpy's own calls is called, while entities come and go."""

from __future__ import annotations

import inspect
import random
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from typing import Any

import pytest
import rclpy
from rclpy.callback_groups import MutuallyExclusiveCallbackGroup, ReentrantCallbackGroup
from rclpy.event_handler import (
    PublisherEventCallbacks,
    QoSPublisherEventType,
    QoSSubscriptionEventType,
    SubscriptionEventCallbacks,
)
from rclpy.exceptions import InvalidHandle
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.node import Node
from rclpy.task import Future, Task
from std_msgs.msg import Int32

from flexbt_common.middleware.rclpy_private import SWITCH
from flexbt_common.middleware.received_messages import LatestMessage
from flexbt_common.runtime.node_executor import NodeExecutor, is_misfit, make_executor
from flexbt_common.runtime.node_runtime import NodeRuntime
from flexbt_msgs.srv import ControlTree
from flexbt_testing.waiting import DEADLINE


class Bench:
    """A node on its executor, turned by the test itself or in a thread."""

    def __init__(self, context: rclpy.Context, make: Callable[..., Any] = NodeExecutor) -> None:
        self.context = context
        self.node = Node('bench', context=context)
        self.faults: list[Exception] = []
        self.executor = make(self.node, self.faults.append, lambda: None, lambda seconds, fn: None)

    def turn_until(self, condition: Callable[[], Any], what: str) -> None:
        end = time.monotonic() + DEADLINE
        while not condition():
            assert time.monotonic() < end, f'{what} did not come'
            self.executor.turn(0.05)

    def request(self, client: Any) -> Any:
        if not client.wait_for_service(DEADLINE):
            raise TimeoutError('the service')
        return client.call_async(ControlTree.Request())

    def close(self) -> None:
        self.executor.shutdown()
        self.node.destroy_node()


@contextmanager
def open_bench(make: Callable[..., Any] = NodeExecutor) -> Iterator[Bench]:
    context = rclpy.Context()
    rclpy.init(args=[], context=context)
    bench = Bench(context, make)
    try:
        yield bench
    finally:
        bench.close()
        rclpy.try_shutdown(context=context)


@pytest.fixture
def bench() -> Iterator[Bench]:
    with open_bench() as bench:
        yield bench


@pytest.fixture(params=['polls', 'resumes'])
def rclpy_that(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    """Up to 7.1.8 rclpy calls a task that awaits in each turn; from 7.1.9 on, the future that it awaits does so."""
    if request.param == 'polls' or 'yield self' in inspect.getsource(Future.__await__):
        return
    plain = Task.__call__

    def wait(future: Any) -> Iterator[Any]:
        if future._pending():
            yield future
        return future.result()

    def call(task: Any) -> None:
        if not inspect.iscoroutine(task._handler):
            plain(task)
        elif task._pending() and not task._executing:
            task._executing = True
            step(task)

    def step(task: Any) -> None:
        try:
            awaited = task._handler.send(None)
        except StopIteration as end:
            task.set_result(end.value)
        except Exception as error:
            task.set_exception(error)
        else:
            awaited._set_executor(task._executor())
            awaited.add_done_callback(lambda _: step(task))
            return
        task._executing = False

    monkeypatch.setattr(Future, '__await__', wait)
    monkeypatch.setattr(Task, '__call__', call)


def test_topics_services_timers_and_guards_are_called_and_faults_stop_none_of_them(bench: Bench) -> None:
    called: dict[str, int] = dict.fromkeys(('topic', 'timer', 'guard', 'service', 'answer', 'soon'), 0)

    def fail(what: str) -> None:
        called[what] += 1
        raise ValueError(what)

    def serve(request: Any, response: Any) -> Any:
        called['service'] += 1
        return response

    def all_called(count: int) -> bool:
        return called['timer'] > 0 and all(called[what] == count for what in called if what != 'timer')

    node = bench.node
    node.create_subscription(Int32, 'numbers', lambda message: fail('topic'), 10)
    node.create_service(ControlTree, 'control', serve)
    numbers, client = node.create_publisher(Int32, 'numbers', 10), node.create_client(ControlTree, 'control')
    timer = node.create_timer(0.001, lambda: fail('timer'))
    guard = node.create_guard_condition(lambda: fail('guard'))
    bench.turn_until(lambda: client.service_is_ready() and numbers.get_subscription_count(), 'the discovery')
    for count in range(1, 4):
        bench.request(client).add_done_callback(lambda future: fail('answer'))
        numbers.publish(Int32())
        guard.trigger()
        bench.executor.create_task(fail, 'soon')
        bench.turn_until(partial(all_called, count), f'call {count}')
    timer.cancel()
    told = sorted({str(fault) for fault in bench.faults})
    assert told == ['answer', 'guard', 'soon', 'timer', 'topic']
    ticks = called['timer']
    assert ticks
    bench.executor.turn(0.01)
    bench.executor.turn(0.01)
    assert called['timer'] == ticks


@pytest.mark.parametrize('kind', [QoSPublisherEventType, QoSSubscriptionEventType])
def test_only_events_of_ends_that_do_not_fit_may_come_late(kind: Any) -> None:
    assert {name for name, event in kind.__members__.items() if is_misfit(event)} == {
        name for name in kind.__members__ if 'INCOMPATIBLE' in name
    }


@pytest.mark.parametrize('stock', ['0', '1'])
def test_a_message_that_nobody_waits_for_is_kept_for_who_asks(monkeypatch: pytest.MonkeyPatch, stock: str) -> None:
    monkeypatch.setenv(SWITCH, stock)
    with open_bench(make_executor) as bench:
        awaits = threading.Event()
        called: list[int | None] = []

        def newest() -> int | None:
            message = latest.message
            return None if message is None else int(message.data)

        def tell() -> None:
            called.append(newest())

        latest = LatestMessage(bench.node, Int32, 'numbers', 1, tell, awaits.is_set)
        numbers = bench.node.create_publisher(Int32, 'numbers', 10)
        bench.turn_until(numbers.get_subscription_count, 'the discovery')
        for number in range(50):
            numbers.publish(Int32(data=number))
            bench.executor.turn(0.001)
        bench.turn_until(lambda: newest() == 49, 'the newest message')
        assert called == []
        awaits.set()
        numbers.publish(Int32(data=50))
        bench.turn_until(lambda: called == [50], 'the message that is awaited')
        latest.close()
        assert newest() == 50


def test_what_nobody_waits_for_is_not_taken_when_all_is_checked_either(
    bench: Bench, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr('flexbt_common.runtime.node_executor._CHECK_SECONDS', 0.0)
    taken: list[int] = []

    def on_message(data: bytes) -> None:
        """Do nothing: the function below takes it."""

    on_message.is_awaited = lambda: False  # type: ignore[attr-defined]
    on_message.take_all = lambda _subscription: taken.append(1)  # type: ignore[attr-defined]
    numbers = bench.node.create_publisher(Int32, 'numbers', 1)
    bench.node.create_subscription(Int32, 'numbers', on_message, 1, raw=True)
    bench.turn_until(numbers.get_subscription_count, 'the discovery')
    for number in range(20):
        numbers.publish(Int32(data=number))
        bench.executor.turn(0.005)
    assert taken == []


def test_entities_come_and_go_in_callbacks_and_other_threads_and_nothing_is_lost(bench: Bench) -> None:
    """A random walk: each number that is published while a subscription is there comes once, in order."""
    chance = random.Random(3)
    node, lock = bench.node, threading.Lock()
    topics = [f'topic{number}' for number in range(4)]
    publishers = [node.create_publisher(Int32, topic, 1000) for topic in topics]
    live: dict[int, tuple[Any, list[int]]] = {}
    over, churn_faults = threading.Event(), list[BaseException]()

    def churn() -> None:
        """Short-lived entities of all kinds, from a thread of its own."""
        try:
            while not over.is_set():
                subscription = node.create_subscription(Int32, 'topic0', lambda message: None, 10)
                timer = node.create_timer(0.001, lambda: None)
                service = node.create_service(ControlTree, f'churn{chance.randrange(3)}', lambda _, response: response)
                client = node.create_client(ControlTree, 'churn0')
                time.sleep(0.002)
                node.destroy_timer(timer)
                node.destroy_subscription(subscription)
                node.destroy_client(client)
                node.destroy_service(service)
        except BaseException as error:
            churn_faults.append(error)

    def listen(number: int) -> None:
        seen: list[int] = []
        live[number] = (
            node.create_subscription(Int32, topics[number], lambda m: hear(number, seen, m.data), 1000),
            seen,
        )

    def hear(number: int, seen: list[int], value: int) -> None:
        seen.append(value)
        if value % 50 == 49:  # while it is being called
            other = (number + 1) % len(topics)
            with lock:
                if other in live:
                    node.destroy_subscription(live.pop(other)[0])
                else:
                    listen(other)

    thread = threading.Thread(target=churn)
    for number in range(len(topics)):
        listen(number)
    bench.turn_until(lambda: all(one.get_subscription_count() for one in publishers), 'the discovery')
    thread.start()
    try:
        for value in range(300):
            number = chance.randrange(len(topics))
            publishers[number].publish(Int32(data=value))
            bench.executor.turn(0.0)
        kept = node.create_subscription(Int32, 'last', lambda message: last.append(message.data), 10)
        last: list[int] = []
        end = node.create_publisher(Int32, 'last', 10)
        bench.turn_until(end.get_subscription_count, 'the discovery of the last topic')
        end.publish(Int32(data=1))
        bench.turn_until(lambda: last == [1], 'the last message')
        assert kept is not None
    finally:
        over.set()
        thread.join()
    assert not churn_faults and not bench.faults
    for _, seen in live.values():
        assert seen == sorted(set(seen))


def test_what_another_thread_is_destroying_is_waited_for_no_more(bench: Bench) -> None:
    seen: list[int] = []
    numbers = bench.node.create_publisher(Int32, 'numbers', 10)
    bench.node.create_subscription(Int32, 'numbers', lambda message: seen.append(message.data), 10)
    events = SubscriptionEventCallbacks(liveliness=lambda event: None)
    other = bench.node.create_subscription(Int32, 'others', lambda message: None, 10, event_callbacks=events)
    bench.turn_until(numbers.get_subscription_count, 'the discovery')
    bench.executor.turn(0.0)  # which has seen all of them
    for handler in other.event_handlers:
        handler.destroy()  # which rclpy does before it wakes the executor
    bench.executor.turn(0.0)
    numbers.publish(Int32(data=1))
    bench.turn_until(lambda: seen == [1], 'the message')


def test_a_callback_that_uses_a_destroyed_entity_is_a_fault_and_one_that_destroys_its_own_is_none(bench: Bench) -> None:
    node = bench.node
    gone = node.create_publisher(Int32, 'gone', 10)
    node.destroy_publisher(gone)
    called: list[str] = []

    def use(what: str, *_: Any) -> None:
        called.append(what)
        gone.publish(Int32())

    def end(_: Any, response: Any) -> Any:
        called.append('ending')
        node.destroy_service(ending)
        return response

    node.create_subscription(Int32, 'numbers', partial(use, 'topic'), 10)
    newest = LatestMessage(node, Int32, 'numbers', 10, partial(use, 'newest'), lambda: True)
    guard = node.create_guard_condition(partial(use, 'guard'))
    ending = node.create_service(ControlTree, 'ending', end)
    numbers, client = node.create_publisher(Int32, 'numbers', 10), node.create_client(ControlTree, 'ending')
    bench.turn_until(lambda: client.service_is_ready() and numbers.get_subscription_count() == 2, 'the discovery')
    numbers.publish(Int32())
    guard.trigger()
    bench.request(client)
    bench.turn_until(lambda: len(called) == 4, 'the calls')
    assert sorted(called) == ['ending', 'guard', 'newest', 'topic']
    assert [type(fault) for fault in bench.faults] == [InvalidHandle] * 3
    newest.close()


def test_the_wait_set_is_made_anew_when_the_node_has_changed_and_only_then(bench: Bench) -> None:
    seen: list[int] = []
    node = bench.node
    numbers = node.create_publisher(Int32, 'numbers', 10)
    subscription = node.create_subscription(Int32, 'numbers', lambda message: seen.append(message.data), 10)
    client = node.create_client(ControlTree, 'control')
    node.create_service(ControlTree, 'control', lambda request, response: response)
    bench.turn_until(lambda: numbers.get_subscription_count() and client.service_is_ready(), 'the discovery')
    bench.executor.turn(0.0)
    kept = bench.executor._entities
    for count in range(10):
        numbers.publish(Int32(data=count))
        answer = bench.request(client)
        bench.turn_until(answer.done, 'the answer')
    bench.turn_until(lambda: len(seen) == 10, 'the numbers')
    assert bench.executor._entities is kept
    node.destroy_subscription(subscription)
    bench.executor.turn(0.0)
    bench.executor.turn(0.0)
    assert bench.executor._entities is not kept


@pytest.mark.usefixtures('rclpy_that')
@pytest.mark.parametrize('group', [MutuallyExclusiveCallbackGroup, ReentrantCallbackGroup])
def test_a_service_that_awaits_holds_up_its_group_only(bench: Bench, group: type[Any]) -> None:
    node, held = bench.node, Future()
    order: list[str] = []
    began = 0

    async def serve(request: Any, response: Any) -> Any:
        nonlocal began
        began += 1
        order.append(f'began {began}')
        await held
        response.message = 'at last'
        order.append('ended')
        return response

    callback_group = group()
    node.create_service(ControlTree, 'slow', serve, callback_group=callback_group)
    node.create_service(ControlTree, 'quick', lambda _, response: response, callback_group=ReentrantCallbackGroup())
    others = ReentrantCallbackGroup()
    slow, quick = (node.create_client(ControlTree, name, callback_group=others) for name in ('slow', 'quick'))
    bench.turn_until(lambda: slow.service_is_ready() and quick.service_is_ready(), 'the services')
    answers = [bench.request(slow), bench.request(slow)]
    bench.turn_until(lambda: began, 'the slow service')
    for _ in range(20):
        answer = bench.request(quick)
        bench.turn_until(answer.done, 'the quick answer')
    is_exclusive = group is MutuallyExclusiveCallbackGroup
    assert order == (['began 1'] if is_exclusive else ['began 1', 'began 2'])
    bench.executor.create_task(held.set_result, None)
    bench.turn_until(lambda: all(answer.done() for answer in answers), 'the slow answers')
    assert [answer.result().message for answer in answers] == ['at last'] * 2
    assert order == (
        ['began 1', 'ended', 'began 2', 'ended'] if is_exclusive else ['began 1', 'began 2'] + ['ended'] * 2
    )
    answer = bench.request(quick)
    bench.turn_until(answer.done, 'the quick answer')
    assert not bench.executor._awaiting
    assert not bench.faults


@pytest.mark.usefixtures('rclpy_that')
def test_a_coroutine_that_fails_after_it_awaited_is_told(bench: Bench) -> None:
    held = Future()

    async def fail(_: Int32) -> None:
        await held
        raise ValueError('after all')

    bench.node.create_subscription(Int32, 'numbers', fail, 10)
    numbers = bench.node.create_publisher(Int32, 'numbers', 10)
    bench.turn_until(numbers.get_subscription_count, 'the discovery')
    numbers.publish(Int32())
    bench.turn_until(lambda: bench.executor._awaiting, 'the coroutine')
    held.set_result(None)
    bench.turn_until(lambda: bench.faults, 'the fault')
    bench.turn_until(lambda: not bench.executor._awaiting, 'the end of the coroutine')
    bench.executor.turn(0.0)
    assert [str(fault) for fault in bench.faults] == ['after all']


def test_a_coroutine_that_is_cancelled_is_let_go(bench: Bench) -> None:
    held = Future()

    async def wait() -> None:
        await held

    task = bench.executor.create_task(wait)
    for _ in range(3):
        bench.executor.turn(0.0)
    assert bench.executor._awaiting == [task]
    task.cancel()
    bench.turn_until(lambda: not bench.executor._awaiting, 'the end of the coroutine')


@pytest.mark.usefixtures('rclpy_that')
def test_what_is_destroyed_after_an_await_leaves_the_graph(bench: Bench) -> None:
    node, held = bench.node, Future()

    async def wait() -> None:
        await held

    bench.executor.create_task(wait)
    bench.turn_until(lambda: bench.executor._awaiting, 'the coroutine')
    subscription = node.create_subscription(Int32, 'numbers', lambda message: None, 10)
    for callback in (lambda event: None, lambda event: held.set_result(None)):
        node.create_publisher(Int32, 'numbers', 10, event_callbacks=PublisherEventCallbacks(matched=callback))
    bench.turn_until(held.done, 'the event that ends the coroutine')
    bench.turn_until(lambda: not bench.executor._awaiting, 'the end of the coroutine')
    node.destroy_subscription(subscription)
    bench.turn_until(lambda: node.count_subscribers('numbers') == 0, 'the end of the subscription')


def test_of_what_is_destroyed_nothing_is_kept(bench: Bench) -> None:
    known = bench.node.default_callback_group.entities
    bench.executor.turn(0.0)
    before = len(known)
    for _ in range(20):
        bench.node.destroy_service(bench.node.create_service(ControlTree, 'control', lambda _, response: response))
        bench.executor.turn(0.0)
    assert len(known) == before


def test_a_coroutine_of_another_thread_ends_the_wait_however_late_it_is_known(
    bench: Bench, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The thread stops where rclpy has woken the executor, until that waits again."""
    create = SingleThreadedExecutor.create_task
    waits = threading.Event()

    def create_slowly(*arguments: Any) -> Any:
        waits.clear()
        task = create(*arguments)
        waits.wait(DEADLINE)
        time.sleep(0.02)
        return task

    monkeypatch.setattr(SingleThreadedExecutor, 'create_task', create_slowly)
    ran = threading.Event()

    async def run() -> None:
        ran.set()

    bench.executor.turn(0.0)
    thread = threading.Thread(target=lambda: bench.executor.create_task(run))
    thread.start()
    end = time.monotonic() + DEADLINE
    while not ran.is_set():
        waits.set()
        bench.executor.turn(DEADLINE)
    thread.join()
    assert time.monotonic() < end


def test_a_guest_hears_of_what_was_called_just_before_it_came() -> None:
    with NodeRuntime.open('host') as runtime:
        called = threading.Event()
        timer = runtime.call(lambda: runtime.node.create_timer(0.001, called.set))
        assert called.wait(DEADLINE)
        runtime.call(timer.cancel)
        runtime.call(lambda: None)  # the turn in which it was called is over
        guest = SingleThreadedExecutor(context=runtime.node.context)
        guest.add_node(runtime.node)
        spinning = threading.Thread(target=guest.spin_once, daemon=True)
        spinning.start()
        spinning.join(DEADLINE)
        assert not spinning.is_alive()


@pytest.mark.usefixtures('rclpy_that')
def test_a_coroutine_begins_before_what_is_brought_in_after_it(bench: Bench) -> None:
    """As with rclpy's own executor: the callback of an action goal begins before a cancel is told of."""
    order: list[str] = []
    held = Future()

    async def begin(name: str) -> None:
        order.append(name)
        await held

    guard = bench.node.create_guard_condition(
        lambda: [bench.executor.create_task(begin, name) for name in ('first', 'second')]
    )
    for count in (2, 4):
        guard.trigger()
        bench.executor.turn(1.0)
        while not order[count - 2 :]:  # the wait may have ended for another reason
            bench.executor.turn(1.0)
        assert sorted(order) == sorted(['first', 'second'] * (count // 2))
    held.set_result(None)
    bench.turn_until(lambda: not bench.executor._awaiting, 'the end of the coroutines')


def test_tasks_of_other_threads_end_the_wait(bench: Bench) -> None:
    results: list[int] = []

    async def double(number: int) -> int:
        return 2 * number

    def ask() -> None:
        for number in range(50):
            create = bench.executor.create_task
            task = create(double, number) if number % 2 else create(lambda number=number: 2 * number)
            end = time.monotonic() + DEADLINE
            while not task.done() and time.monotonic() < end:
                time.sleep(0.0005)
            results.append(task.result())

    thread = threading.Thread(target=ask)
    thread.start()
    while thread.is_alive():
        bench.executor.turn(1.0)
    assert results == [2 * number for number in range(50)]


def test_the_end_of_the_context_ends_the_turn(bench: Bench) -> None:
    ends = threading.Timer(0.05, lambda: rclpy.try_shutdown(context=bench.context))
    ends.start()
    with pytest.raises(ExternalShutdownException):
        while True:
            bench.executor.turn(None)
    ends.join()
