# SPDX-License-Identifier: BSD-3-Clause
"""What is wrong with the simulated time of a node, as the node and those who watch it tell it."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator
from typing import Any

import pytest
from builtin_interfaces.msg import Time
from rclpy.parameter import Parameter
from rosgraph_msgs.msg import Clock

from flexbt_common.lifecycle.liveliness import LivelinessToken, LivelinessWatch
from flexbt_common.middleware.received_messages import reports_writers
from flexbt_common.names import CLOCK
from flexbt_common.runtime import clock_watch
from flexbt_common.runtime.clock_watch import ClockHealth, clock_health
from flexbt_common.runtime.node_runtime import NodeRuntime
from flexbt_testing.waiting import wait_until

THIRTY_YEARS = 30 * 365 * 86_400


@pytest.fixture(autouse=True)
def quick(monkeypatch: pytest.MonkeyPatch) -> None:
    for name, seconds in (
        ('STILL_SECONDS', 1.0),
        ('SHOWN_SECONDS', 0.5),
        ('LISTEN_SECONDS', 0.3),
        ('PAUSE_SECONDS', 0.1),
        ('_LOOK_SECONDS', 0.1),
        ('_LOOK_TOLERANCE', 0.0),
        ('_WINDOW_SECONDS', 1.5),
    ):
        monkeypatch.setattr(clock_watch, name, seconds)


@pytest.fixture
def robot() -> Iterator[NodeRuntime]:
    with NodeRuntime.open('robot', parameters={'use_sim_time': True}) as runtime:
        yield runtime


@pytest.fixture
def simulator() -> Iterator[NodeRuntime]:
    with NodeRuntime.open('simulator') as runtime:
        yield runtime


def health_of(runtime: NodeRuntime) -> ClockHealth:
    return runtime.call(lambda: clock_health(runtime))


def publish(runtime: NodeRuntime, time_of: Callable[[int], Time]) -> Callable[[], None]:
    """Publish the times of all numbers, one after the other, 100 a second; gives how to end that."""
    publisher: Any = runtime.call(lambda: runtime.node.create_publisher(Clock, CLOCK, 10))
    numbers, has_ended = itertools.count(), [False]

    def tell() -> None:
        if not has_ended[0]:
            publisher.publish(Clock(clock=time_of(next(numbers))))
            runtime.steady.call_at(runtime.steady.now() + 0.01, tell)

    def end() -> None:
        has_ended[0] = True

    tell()
    return end


def running(number: int) -> Time:
    return Time(sec=1 + number // 100, nanosec=number % 100 * 10_000_000)


def test_a_node_waits_for_a_time_that_nobody_publishes_and_is_not_ready(
    robot: NodeRuntime, simulator: NodeRuntime
) -> None:
    LivelinessToken(robot).set_ready(True)
    watch, health = LivelinessWatch(simulator, '/robot'), health_of(robot)
    wait_until(lambda: 'nobody publishes /clock, and use_sim_time is set' in health.problem, 'what is wrong')
    wait_until(lambda: watch.alive and not watch.ready and 'nobody publishes' in watch.problem, 'what others know')
    end = publish(simulator, running)
    wait_until(lambda: not health.problem and watch.ready, lambda: f'all is well: {health.problem!r}')
    end()
    wait_until(lambda: '/simulator is paused, or hangs' in health.problem, lambda: health.problem)
    assert watch.ready, 'a pause is no fault of the node'
    simulator.close()
    wait_until(lambda: 'nobody publishes /clock any more' in health.problem, lambda: health.problem)


@pytest.mark.parametrize(
    ('told', 'time_of'),
    [
        ('has times that are none, such as -2 s and 0 ns', lambda number: Time(sec=-2)),
        ('such as 3 s and 4000000000 ns', lambda number: Time(sec=3, nanosec=4_000_000_000)),
        ('has jumped by', lambda number: Time(sec=3 + number // 7 % 2 * THIRTY_YEARS, nanosec=number)),
        ('has jumped by', lambda number: Time(sec=1000 - number % 500)),
        ('is slow', lambda number: Time(sec=3, nanosec=number * 10_000)),
    ],
    ids=['negative', 'too many nanoseconds', 'thirty years', 'back', 'slow'],
)
def test_a_time_that_does_not_go_on_as_it_should_is_told(
    robot: NodeRuntime, simulator: NodeRuntime, told: str, time_of: Callable[[int], Time]
) -> None:
    health = health_of(robot)
    end = publish(simulator, time_of)
    wait_until(lambda: told in health.problem, lambda: health.problem)
    end()
    publish(simulator, lambda number: Time(sec=5000 + number))
    wait_until(lambda: not health.problem, lambda: health.problem)


@pytest.mark.skipif(not reports_writers(), reason='rclpy as it is does not tell writers')
def test_several_publishers_are_told_and_named(robot: NodeRuntime, simulator: NodeRuntime) -> None:
    health = health_of(robot)
    publish(simulator, running)
    with NodeRuntime.open('bag') as bag:
        publish(bag, lambda number: Time(sec=9000 + number))
        wait_until(lambda: '2 publishers of /clock (/bag, /simulator)' in health.problem, lambda: health.problem)
    wait_until(lambda: not health.problem, lambda: health.problem)


def set_simulated(runtime: NodeRuntime, value: bool) -> None:
    """As `ros2 param set` does, while the node runs; waits until that is known to be wrong, or not."""
    parameter = Parameter('use_sim_time', value=value)
    runtime.call(lambda: runtime.node.set_parameters([parameter]))
    health = health_of(runtime)
    wait_until(lambda: ('nobody publishes' in health.problem) is value, lambda: health.problem)


def test_time_that_is_simulated_from_some_moment_on_is_watched_from_then(simulator: NodeRuntime) -> None:
    set_simulated(simulator, True)
    set_simulated(simulator, False)
    assert not health_of(simulator).problem


@pytest.mark.skipif(not reports_writers(), reason='rclpy as it is does not tell writers')
def test_who_publishes_the_time_is_nothing_to_a_node_whose_time_is_not_simulated_any_more(
    robot: NodeRuntime, simulator: NodeRuntime
) -> None:
    health = health_of(robot)
    publish(simulator, running)
    with NodeRuntime.open('bag') as bag:
        publish(bag, lambda number: Time(sec=9000 + number))
        wait_until(lambda: '2 publishers of /clock' in health.problem, lambda: health.problem)
        problems: list[str] = []
        robot.call(lambda: robot.node.set_parameters([Parameter('use_sim_time', value=False)]))
        wait_until(lambda: not health.problem, lambda: health.problem)
        robot.call(lambda: health.add_listener(lambda: problems.append(health.problem)))
        until = robot.steady.now() + 2.0 * (clock_watch.STILL_SECONDS + clock_watch.LISTEN_SECONDS)
        wait_until(lambda: robot.steady.now() > until, 'the time for another look')
        assert not problems


def test_a_problem_that_comes_and_goes_is_reported_once(robot: NodeRuntime, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(clock_watch, 'SHOWN_SECONDS', 3600.0)
    reports: list[str] = []
    health_of(robot).report = reports.append
    for value in (False, True) * 3:
        set_simulated(robot, value)
    assert [bool(report) for report in reports] in ([True, False], [False, True])
