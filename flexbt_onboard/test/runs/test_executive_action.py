# SPDX-License-Identifier: BSD-3-Clause
"""Behaviors as an action: parameters and inputs go in, active states and outputs come out, and canceling stops."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator
from typing import Any

import pytest
from action_msgs.msg import GoalStatus
from rclpy.action import ActionClient

from flexbt_common.runtime.node_runtime import NodeRuntime
from flexbt_common.values.entries import from_entry, to_entry
from flexbt_core.state_machine.authoring.machine import OperatableStateMachine
from flexbt_core.state_machine.engine.events import RunEvent, RunReader
from flexbt_core.state_machine.model.event_state import EventState
from flexbt_msgs.action import BtExecute, ExecuteBehavior
from flexbt_msgs.msg import BehaviorArgument, ExecutiveCommand, ExecutiveStatus
from flexbt_onboard.behaviors.behavior import Behavior, BehaviorManifest, BehaviorParameter
from flexbt_onboard.node import action_servers
from flexbt_onboard.node.executive_parameters import ExecutiveParameters
from flexbt_onboard.runs.run_events import BehaviorEnded, StatusSent
from flexbt_testing.nodes.executive_bench import ExecutiveBench
from flexbt_testing.waiting import wait_until

Result = ExecuteBehavior.Result


class Twice(EventState):
    """Doubles a number; waits for ever when it is negative; gives something that cannot be sent for 13."""

    def __init__(self, factor: int) -> None:
        super().__init__(outcomes=['done', 'zero'], input_keys=['x'], output_keys=['y'], desired_rate=None)
        self._factor = factor

    def execute(self, userdata: Any) -> str | None:
        x = userdata['x']
        if x < 0:
            return None
        if x == 7:
            raise RuntimeError('seven')
        userdata['y'] = object() if x == 13 else x * self._factor
        return 'done' if x else 'zero'


class Multiply(Behavior):
    manifest = BehaviorManifest('Multiply', parameters=[BehaviorParameter('factor', 2)])
    factor: int

    def create(self) -> OperatableStateMachine:
        machine = OperatableStateMachine(outcomes=['finished', 'nothing'], input_keys=['x'], output_keys=['y'])
        with machine:
            OperatableStateMachine.add('Twice', Twice(self.factor), {'done': 'finished', 'zero': 'nothing'})
        return machine


class Client:
    """A program on a node of its own."""

    def __init__(self) -> None:
        self.runtime = NodeRuntime('program', args=())
        self.feedback: list[list[str]] = []
        self.results: list[Any] = []
        self.handle: Any = None
        self.client: Any = self.runtime.call(
            lambda: ActionClient(self.runtime.node, ExecuteBehavior, 'execute_behavior')
        )
        wait_until(lambda: self.runtime.call(self.client.server_is_ready), 'execute_behavior')

    def send(self, x: int, **fields: Any) -> None:
        """Send a goal; the result comes later."""
        goal = ExecuteBehavior.Goal(behavior='Multiply', inputs=[to_entry('x', x)], autonomy=3)
        for name, value in fields.items():
            setattr(goal, name, value)
        self.handle = None

        def accepted(future: Any) -> None:
            self.handle = future.result()
            self.handle.get_result_async().add_done_callback(lambda done: self.results.append(done.result()))

        def on_feedback(message: Any) -> None:
            self.feedback.append(list(message.feedback.active_states))

        self.runtime.call(lambda: self.client.send_goal_async(goal, on_feedback).add_done_callback(accepted))

    def cancel(self) -> None:
        """Cancel the goal that was sent last, once it is accepted: its behavior may begin before that is known."""
        wait_until(lambda: self.handle, 'acceptance')
        self.runtime.call(self.handle.cancel_goal_async)

    def result(self) -> tuple[int, Any]:
        """Status and result of the next goal that ends."""
        wait_until(lambda: self.results, 'result')
        answer = self.results.pop(0)
        return answer.status, answer.result

    def run(self, x: int, **fields: Any) -> tuple[int, Any]:
        """Send a goal, and wait for its result."""
        self.send(x, **fields)
        return self.result()


BUILDING = threading.Event()
BUILT = threading.Event()


class Slow(Behavior):
    manifest = BehaviorManifest('Slow')

    def create(self) -> OperatableStateMachine:
        BUILDING.set()
        BUILT.wait(60.0)
        return Multiply().create()


@pytest.fixture
def bench() -> Iterator[ExecutiveBench]:
    BUILDING.clear()
    BUILT.clear()
    bench = ExecutiveBench(Multiply, Slow)
    yield bench
    bench.close()


@pytest.fixture
def client(bench: ExecutiveBench) -> Iterator[Client]:
    client = Client()
    yield client
    client.runtime.close()


def test_inputs_and_parameters_go_in_and_outcome_and_outputs_come_out(bench: ExecutiveBench, client: Client) -> None:
    status, result = client.run(21)
    assert (status, result.code, result.outcome) == (GoalStatus.STATUS_SUCCEEDED, Result.SUCCESS, 'finished')
    assert [(entry.key, from_entry(entry)) for entry in result.outputs] == [('y', 42)]
    three = [BehaviorArgument(name='factor', value='3')]
    _, result = client.run(5, arguments=three, output_encoding=BtExecute.Goal.BINARY)
    assert from_entry(result.outputs[0]) == 15
    assert client.run(0)[1].outcome == 'nothing'
    assert bench.wait_idle() == 'nothing'
    assert bench.status.autonomy == ExecutiveParameters().autonomy  # the operator's, not that of the goals


@pytest.mark.parametrize(
    ('x', 'fields', 'code', 'words'),
    [
        (1, {'behavior': 'Multiplu'}, Result.FAILURE, 'Multiply'),
        (1, {'arguments': [BehaviorArgument(name='factor', value='two')]}, Result.FAILURE, 'whole number'),
        (1, {'inputs': []}, Result.FAILURE, "'x' is needed"),
        (1, {'autonomy': 9}, Result.FAILURE, 'autonomy 9'),
        (7, {}, Result.ERROR, 'raised'),
        (13, {}, Result.ERROR, 'cannot be sent: y'),
    ],
)
def test_what_goes_wrong_is_told_with_its_reason(
    client: Client, x: int, fields: dict[str, Any], code: int, words: str
) -> None:
    status, result = client.run(x, **fields)
    assert (status, result.code, result.outcome) == (GoalStatus.STATUS_ABORTED, code, '')
    assert words in result.message
    assert client.run(4)[1].code == Result.SUCCESS


def test_canceling_stops_the_run_and_an_operator_may_stop_it_too(bench: ExecutiveBench, client: Client) -> None:
    client.send(-1)
    bench.wait_active('/Twice')
    wait_until(lambda: client.feedback == [['/Twice']], lambda: f'feedback {client.feedback}')
    assert 'is running' in client.run(1)[1].message
    client.cancel()  # of the goal that has ended: nothing happens
    client.send(-1)
    assert client.result()[1].code == Result.FAILURE
    bench.applied(ExecutiveCommand.STOP)
    status, result = client.result()
    assert (status, result.code) == (GoalStatus.STATUS_ABORTED, Result.CANCELED)
    assert 'operator tester' in result.message
    client.send(-1)
    bench.wait_active('/Twice')
    client.cancel()
    status, result = client.result()
    assert (status, result.code) == (GoalStatus.STATUS_CANCELED, Result.CANCELED)
    assert bench.wait_idle() == 'preempted'


def test_a_goal_that_is_canceled_while_its_behavior_is_built_is_canceled(bench: ExecutiveBench, client: Client) -> None:
    client.send(1, behavior='Slow')
    wait_until(BUILDING.is_set, 'building')
    client.cancel()
    bench.wait_for(lambda status: status.state == ExecutiveStatus.STOPPING, 'canceled')
    BUILT.set()
    status, result = client.result()
    assert (status, result.code) == (GoalStatus.STATUS_CANCELED, Result.CANCELED)
    assert 'before it began' in result.message
    assert client.run(4)[1].code == Result.SUCCESS


def test_a_run_whose_client_is_gone_is_stopped(bench: ExecutiveBench, client: Client) -> None:
    client.send(-1)
    bench.wait_active('/Twice')
    wait_until(lambda: client.feedback, 'feedback')
    client.runtime.close()
    assert bench.wait_idle() == 'preempted'
    assert 'client' in bench.status.message


def test_the_clients_of_a_goal_are_looked_for_twice_a_second_however_many_statuses_are_sent(
    bench: ExecutiveBench, client: Client, monkeypatch: pytest.MonkeyPatch
) -> None:
    client.send(-1)
    bench.wait_active('/Twice')
    looks: list[float] = []
    node, readers = bench.runtime.node, bench.executive.runs.readers
    (server,) = (one for one in readers if isinstance(one, action_servers.BehaviorActionServer))
    ask = node.get_publishers_info_by_topic

    def look(*given: Any, **named: Any) -> Any:
        looks.append(time.monotonic())
        return ask(*given, **named)

    def tell() -> None:
        for _ in range(100):
            server.read(StatusSent())

    monkeypatch.setattr(node, 'get_publishers_info_by_topic', look)
    began = bench.runtime.steady.now()
    bench.runtime.call(tell)
    assert len(looks) <= 1.0 + (bench.runtime.steady.now() - began) / action_servers.LOOK_SECONDS


def test_a_client_that_has_come_since_does_not_stand_in_for_the_one_that_is_gone(
    bench: ExecutiveBench, client: Client, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As a program that was killed, and is started again before the middleware misses it."""
    monkeypatch.setattr(action_servers, 'DISCOVERY_SECONDS', 1.0)
    first = Client()
    client.runtime.close()
    first.send(-1)
    bench.wait_active('/Twice')
    until = bench.runtime.steady.now() + 2.0 * action_servers.DISCOVERY_SECONDS
    wait_until(lambda: bench.runtime.steady.now() > until, 'the time for the discovery of clients')
    next_one = Client()
    first.runtime.close()
    assert bench.wait_idle() == 'preempted'
    assert 'client' in bench.status.message
    next_one.runtime.close()


class GoalAtEnd(RunReader):
    """Send a goal at the end of a run, when another one can start, before further readers have read the end."""

    def __init__(self, bench: ExecutiveBench, client: Client) -> None:
        self._bench = bench
        self._client = client

    def read(self, event: RunEvent) -> None:
        if isinstance(event, BehaviorEnded):
            runs, call = self._bench.executive.runs, self._bench.runtime.call
            runs.readers.remove(self)
            wait_until(lambda: call(lambda: runs.run) is None, 'the end of the run')
            self._client.send(-1)
            wait_until(lambda: call(lambda: runs.run) is not None, 'the next run')


def test_a_goal_that_comes_at_the_end_of_another_run_has_its_own_result(bench: ExecutiveBench, client: Client) -> None:
    other = Client()
    bench.executive.runs.readers.insert(0, GoalAtEnd(bench, client))
    other.send(21)
    assert other.result()[1].outcome == 'finished'
    bench.wait_active('/Twice')
    assert not client.results
    client.cancel()
    assert client.result()[0] == GoalStatus.STATUS_CANCELED
    other.runtime.close()
