# SPDX-License-Identifier: BSD-3-Clause
"""The node's clock: timers in real and in simulated time, and jumps of the latter."""

from __future__ import annotations

import functools
import queue
import threading
import time
from collections.abc import Callable, Iterator
from typing import Any, cast

import pytest
from builtin_interfaces.msg import Time
from rclpy.clock import ClockType, JumpThreshold, ROSClock, TimeJump
from rclpy.duration import Duration
from rclpy.exceptions import InvalidHandle
from rclpy.parameter import Parameter
from rclpy.qos import QoSProfile
from rclpy.subscription import Subscription
from rclpy.time import Time as RosTime
from rosgraph_msgs.msg import Clock as ClockMessage

from flexbt_common.middleware.rclpy_private import EXECUTOR, is_usable
from flexbt_common.runtime.node_runtime import NodeRuntime
from flexbt_common.runtime.ros_clock import LONGEST_WAIT, HandledTime, SimulatedTime
from flexbt_core.clock.clock import ManualClock, Timer
from flexbt_core.clock.waiting import WakeEvent
from flexbt_testing.waiting import DEADLINE, wait_until


class Simulation:
    """A node under simulated time and a hand on its clock."""

    def __init__(self, runtime: NodeRuntime) -> None:
        self.runtime = runtime
        self.publisher: Any = runtime.call(
            lambda: runtime.node.create_publisher(ClockMessage, '/clock', QoSProfile(depth=10))
        )

    def set(self, seconds: float) -> None:
        """Move ROS time to ``seconds``, and wait until the node knows."""
        deadline = time.monotonic() + DEADLINE
        while True:
            sent = self.publish(seconds)
            if self.runtime.call(self.runtime.clock.stamp) == sent:
                return
            assert time.monotonic() < deadline, 'simulated time did not arrive'
            time.sleep(0.005)

    def publish(self, seconds: float) -> Time:
        """Say that it is so late."""
        time_message = Time(sec=int(seconds), nanosec=round(seconds % 1 * 1e9))
        self.publisher.publish(ClockMessage(clock=time_message))
        return time_message


@pytest.fixture
def simulation() -> Iterator[Simulation]:
    with NodeRuntime.open('simulated', parameters={'use_sim_time': True}) as runtime:
        yield Simulation(runtime)


@pytest.mark.skipif(not is_usable(EXECUTOR), reason="rclpy's own executor is woken by each message of /clock")
def test_a_node_that_waits_for_no_time_is_not_woken_by_it(simulation: Simulation) -> None:
    simulation.set(1.0)
    runtime = simulation.runtime
    jumps: list[TimeJump] = []
    threshold = JumpThreshold(min_forward=Duration(nanoseconds=1), min_backward=None)
    handle = runtime.node.get_clock().create_jump_callback(threshold, post_callback=jumps.append)
    began = time.monotonic()
    for number in range(200):
        simulation.publish(2.0 + number)
        time.sleep(0.002)
    assert len(jumps) <= (time.monotonic() - began) / LONGEST_WAIT + 5
    wait_until(lambda: runtime.call(runtime.clock.now) == 201.0, 'the last time')
    handle.unregister()


def test_others_are_silent_only_as_long_as_wall_and_world_go_on() -> None:
    wall, world = ManualClock(), ROSClock()
    heard = HandledTime(wall, world)

    def after(seconds: float, simulated: float | None = None) -> float:
        """Return what counts of so much wall time, in which simulated time comes to be this."""
        before = heard.handled
        wall.advance(seconds)
        if simulated is not None:
            world.set_ros_time_override(RosTime(seconds=simulated, clock_type=ClockType.ROS_TIME))
        heard.sample()
        assert heard.handled == before  # nothing has been handled yet
        heard.all_handled()
        return round(heard.handled - before, 9)

    assert after(3.0) == 3.0
    world._set_ros_time_is_active(True)
    assert after(1.0, 50.0) == 1.0  # time begins
    assert after(0.2, 52.0) == 0.2  # ten times as fast
    assert after(30.0, 52.0) == 0.0  # paused
    assert after(0.2, 54.0) <= 0.2 + LONGEST_WAIT  # and ten times as fast again: the pause does not count
    assert after(0.2, 54.01) == 0.01  # slow
    assert [after(0.01) for _ in range(4)] == [0.0] * 4  # looked for other reasons
    assert after(0.01, 54.06) == 0.05  # and nothing of that time is lost
    assert after(0.2, 1.0) == 0.0  # begun anew
    assert after(0.2, 1.1) == 0.1


def test_the_time_is_known_while_the_executor_is_busy(simulation: Simulation) -> None:
    simulation.set(1.0)
    runtime, released = simulation.runtime, threading.Event()
    runtime.post(lambda: released.wait(DEADLINE))
    try:
        simulation.publish(7.0)
        wait_until(lambda: runtime.clock.now() == 7.0, 'the time')
        assert runtime.clock.stamp().sec == 7
    finally:
        released.set()


def test_a_timer_comes_in_time_while_others_ask_for_the_time(simulation: Simulation) -> None:
    """What they take of the middleware does not wake the executor any more."""
    simulation.set(1.0)
    clock, over = simulation.runtime.clock, threading.Event()
    called: list[int] = []

    def ask() -> None:
        while not over.is_set():
            clock.now()

    thread = threading.Thread(target=ask)
    thread.start()
    try:
        for second in range(2, 60):
            clock.call_at(float(second), functools.partial(called.append, second))
            simulation.runtime.call(lambda: None)
            simulation.publish(float(second))
            wait_until(functools.partial(called.__contains__, second), f'the timer for {second} s')
    finally:
        over.set()
        thread.join()


def settled(runtime: NodeRuntime) -> None:
    """Wait until the executor has gone round twice: what was due has been called."""
    for _ in range(2):
        runtime.call(lambda: None)
    time.sleep(0.05)
    runtime.call(lambda: None)


def test_timers_come_in_order_and_not_early() -> None:
    with NodeRuntime.open('real') as runtime:
        clock, done, seen = runtime.clock, threading.Event(), []
        start = clock.now()
        times = [0.05, 0.01, 0.03, 0.01, -1.0, 0.0]

        def timer(offset: float) -> Callable[[], None]:
            def ring() -> None:
                assert clock.now() >= start + offset
                assert runtime.on_executor_thread
                seen.append(offset)
                if len(seen) == len(times):
                    done.set()

            return ring

        for offset in times:
            clock.call_at(start + offset, timer(offset))
        assert done.wait(DEADLINE)
        assert seen[-3:] == [0.01, 0.03, 0.05] or sorted(seen) == sorted(times)
        assert len(seen) == len(times)


def test_who_waits_does_so_while_the_clock_of_the_computer_is_set(monkeypatch: pytest.MonkeyPatch) -> None:
    with NodeRuntime.open('real') as runtime:
        clock, read, seen = runtime.clock, ROSClock.now, queue.SimpleQueue[str]()
        for hours in (1, -1):
            began, start = time.monotonic(), clock.now()  # so that the first is the earlier one
            clock.call_at(start + 0.1, lambda: seen.put('in time'))
            clock.call_at(start + 1000.0, lambda: seen.put('early'))
            with monkeypatch.context() as patched:
                patched.setattr(ROSClock, 'now', lambda of, hours=hours: read(of) + Duration(seconds=3600 * hours))
                assert abs(runtime.call(clock.stamp).sec - start) > 3000, 'time stamps follow the computer'
                assert seen.get(timeout=DEADLINE) == 'in time'
                assert 0.1 <= clock.now() - start <= time.monotonic() - began + 0.001
        assert seen.empty()
        # Of rclpy's clocks, only this one is not concerned.
        assert clock.timer.clock.clock_type is ClockType.STEADY_TIME


def test_a_node_may_follow_simulated_time_from_some_time_on_and_no_more() -> None:
    with NodeRuntime.open('real') as runtime:
        simulation, clock, early = Simulation(runtime), runtime.clock, threading.Event()
        for begin in (100.0, 4000.0):
            simulated, real = threading.Event(), threading.Event()
            clock.call_at(clock.now() + 0.01, real.set)
            assert real.wait(DEADLINE)
            timer = clock.call_at(clock.now() + 50.0, early.set)
            runtime.call(lambda: runtime.node.set_parameters([Parameter('use_sim_time', value=True)]))
            simulation.set(begin)
            clock.call_at(clock.now() + 2.0, simulated.set)
            simulation.set(begin + 1.9)
            settled(runtime)
            assert not simulated.is_set()
            simulation.set(begin + 2.001)  # a float of the time that has passed since 1970 has no ns
            assert simulated.wait(DEADLINE)
            runtime.call(lambda: runtime.node.set_parameters([Parameter('use_sim_time', value=False)]))
            settled(runtime)
            timer.cancel()
        assert not early.is_set() and clock.jumps == 0


def test_what_is_due_comes_while_simulated_time_stands_still(simulation: Simulation) -> None:
    clock, seen = simulation.runtime.clock, queue.SimpleQueue[float]()
    simulation.set(5.0)

    def ring(offset: float) -> None:
        seen.put(offset)
        if offset:
            clock.call_at(5.0, lambda: ring(0.0))

    clock.call_at(4.0, lambda: ring(-1.0))
    assert [seen.get(timeout=DEADLINE) for _ in range(2)] == [-1.0, 0.0]
    clock.call_at(5.0, lambda: ring(0.0))
    assert seen.get(timeout=DEADLINE) == 0.0


def test_a_time_that_is_simulated_again_is_taken_from_its_new_subscription() -> None:
    class Ended:
        @property
        def handle(self) -> Any:
            time.subscription = again  # on the executor thread, while another one asks for the time
            raise InvalidHandle

    time, again = SimulatedTime(lambda error: None), cast('Subscription', object())
    time.subscription = cast('Subscription', Ended())
    time.take_newest()
    assert time.subscription is again


def test_a_wait_goes_on_when_time_is_not_simulated_any_more(simulation: Simulation) -> None:
    clock, early = simulation.runtime.clock, threading.Event()
    simulation.set(time.time() - 1000.0)  # a recording of today
    clock.call_at(clock.now() + 500.0, early.set)
    node = simulation.runtime.node
    simulation.runtime.call(lambda: node.set_parameters([Parameter('use_sim_time', value=False)]))
    settled(simulation.runtime)
    assert not early.is_set()


def test_a_canceled_timer_does_not_come() -> None:
    with NodeRuntime.open('cancel') as runtime:
        clock, done, seen = runtime.clock, threading.Event(), []
        first: Timer = clock.call_at(clock.now() + 0.02, lambda: seen.append('canceled'))
        clock.call_at(clock.now() + 0.05, done.set)
        first.cancel()
        first.cancel()
        assert done.wait(DEADLINE)
        assert seen == []


def test_timers_from_many_threads_all_come() -> None:
    with NodeRuntime.open('threads') as runtime:
        clock, seen, done = runtime.clock, [], threading.Event()

        def ring() -> None:
            seen.append(1)
            if len(seen) == 200:
                done.set()

        def ask() -> None:
            for number in range(50):
                clock.call_at(clock.now() + number % 5 / 200, ring)

        threads = [threading.Thread(target=ask) for _ in range(4)]
        for thread in threads:
            thread.start()
        assert done.wait(DEADLINE)
        for thread in threads:
            thread.join()


def test_who_sleeps_for_a_short_time_needs_no_executor() -> None:
    with NodeRuntime.open('real') as runtime:
        held, woken = threading.Event(), threading.Event()
        runtime.post(lambda: held.wait(DEADLINE))

        def sleep() -> None:
            until = runtime.clock.now() + 0.05
            WakeEvent().wait(runtime.clock, until)
            assert runtime.clock.now() >= until
            woken.set()

        sleeper = threading.Thread(target=sleep, daemon=True)
        sleeper.start()
        assert woken.wait(DEADLINE / 2)
        held.set()
        sleeper.join()


def test_a_ring_ends_a_short_sleep() -> None:
    class NeverQuite(ManualClock):
        def wall_seconds(self, when: float) -> float | None:
            return 0.01

    wake_event, woken = WakeEvent(), threading.Event()

    def sleep() -> None:
        wake_event.wait(NeverQuite(), 1.0)
        woken.set()

    sleeper = threading.Thread(target=sleep, daemon=True)
    sleeper.start()
    assert not woken.wait(0.1)
    wake_event.set()
    assert woken.wait(DEADLINE)
    sleeper.join()


def test_who_sleeps_in_simulated_time_wakes_by_it(simulation: Simulation) -> None:
    simulation.set(100.0)
    clock = simulation.runtime.clock
    woken = threading.Event()

    def sleep() -> None:
        WakeEvent().wait(clock, 100.2)
        woken.set()

    sleeper = threading.Thread(target=sleep, daemon=True)
    sleeper.start()
    assert not woken.wait(0.5), 'wall time has passed, and no other'
    simulation.set(100.2)
    assert woken.wait(DEADLINE)
    sleeper.join()


def test_infinity_is_never_due_and_nan_is_refused() -> None:
    with NodeRuntime.open('far') as runtime:
        seen: list[int] = []
        runtime.clock.call_at(float('inf'), lambda: seen.append(1))
        with pytest.raises(ValueError, match='NaN'):
            runtime.clock.call_at(float('nan'), lambda: None)
        done = threading.Event()
        runtime.clock.call_at(runtime.clock.now() + 0.02, done.set)
        assert done.wait(DEADLINE)
        assert not seen


@pytest.mark.parametrize('when', [float('-inf'), -1e308, 0.0, -1.0])
def test_a_timer_for_a_time_long_ago_comes_at_once_and_stops_no_other(when: float) -> None:
    with NodeRuntime.open('past') as runtime:
        past, done = threading.Event(), threading.Event()
        runtime.clock.call_at(when, past.set)
        runtime.clock.call_at(runtime.clock.now() + 0.02, done.set)
        assert done.wait(DEADLINE)
        assert past.is_set()


def test_simulated_time_moves_the_timers(simulation: Simulation) -> None:
    simulation.set(100.0)
    clock, rung = simulation.runtime.clock, threading.Event()
    assert clock.now() == 100.0
    clock.call_at(102.0, rung.set)
    simulation.set(101.9)
    settled(simulation.runtime)
    assert not rung.is_set()
    simulation.set(102.0)
    assert rung.wait(DEADLINE)


def test_simulated_time_that_stands_still_stops_the_timers(simulation: Simulation) -> None:
    simulation.set(5.0)
    rung = threading.Event()
    simulation.runtime.clock.call_at(5.01, rung.set)
    assert not rung.wait(0.2)


def test_a_jump_back_keeps_what_is_left_to_wait(simulation: Simulation) -> None:
    simulation.set(100.0)
    clock, rung = simulation.runtime.clock, threading.Event()
    clock.call_at(clock.now() + 5.0, rung.set)
    simulation.set(102.0)
    simulation.set(0.5)  # reset of the simulation; three seconds are left
    assert clock.now() == 102.0
    assert simulation.runtime.clock.stamp().sec == 0
    simulation.set(3.4)
    settled(simulation.runtime)
    assert not rung.is_set()
    simulation.set(3.5)
    assert rung.wait(DEADLINE)
    assert clock.now() == 105.0


def test_what_is_waited_for_before_simulated_time_begins_takes_its_time_all_the_same(simulation: Simulation) -> None:
    clock, rung = simulation.runtime.clock, threading.Event()
    clock.call_at(clock.now() + 2.0, rung.set)
    simulation.set(1000.0)
    simulation.set(1001.9)
    settled(simulation.runtime)
    assert not rung.is_set()
    simulation.set(1002.0)
    assert rung.wait(DEADLINE)
    assert clock.now() == 2.0


def test_the_time_never_goes_back(simulation: Simulation) -> None:
    times = []
    for seconds in (10.0, 12.0, 1.0, 2.0, 0.0, 50.0):
        simulation.set(seconds)
        times.append(simulation.runtime.clock.now())
    assert times == [10.0, 12.0, 12.0, 13.0, 13.0, 63.0]
