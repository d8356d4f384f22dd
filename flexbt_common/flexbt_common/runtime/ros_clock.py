# SPDX-License-Identifier: BSD-3-Clause
"""The clock of a ROS node as a :class:`flexbt_core.clock.Clock`, and the simulated time it reads from the
middleware."""

from __future__ import annotations

import contextlib
import math
import threading
import time
from collections.abc import Callable, Iterator
from typing import Any, Final, Protocol

from builtin_interfaces.msg import Time
from rclpy.clock import Clock as RclpyClock
from rclpy.clock import ClockChange, ClockType, JumpThreshold, ROSClock, TimeJump
from rclpy.duration import Duration
from rclpy.event_handler import SubscriptionEventCallbacks
from rclpy.exceptions import InvalidHandle
from rclpy.node import Node
from rclpy.subscription import Subscription
from rclpy.time_source import TimeSource

from flexbt_core.clock.clock import Clock, Timer, TimerQueue

_NANOSECONDS = 1_000_000_000
_FARTHEST = 10.0**9
"""Seconds after which a timer farther away is checked again. rcl counts nanoseconds in 64 bits."""
_LONGEST_STEP = 86_400 * _NANOSECONDS
"""Maximum progress of simulated time from one message to the next, ns; more is a jump."""


class ClockHost(Protocol):
    """The part of a :class:`NodeRuntime` that the clock uses; the runtime itself imports the clock."""

    node: Any
    simulated_time: SimulatedTime

    @property
    def on_executor_thread(self) -> bool:
        """True if the caller is on the executor thread."""

    def post(self, fn: Callable[[], object]) -> None:
        """Run ``fn`` on the executor thread soon."""

    def report_fault(self, error: BaseException, where: str) -> None:
        """Log an exception that the callback of a timer let escape."""


class RosClock:
    """Time of the node in seconds, and timers on it, called on the executor thread.

    The time equals ROS time until the latter jumps back (simulation reset), jumps ahead by a day or more in one
    message (another recording), or a computer's clock is set: such a jump is taken out, so that this time never goes
    back, and a wait of two more seconds lasts that long. So are the jumps between simulated and system time, and that
    with which simulated time begins, from 0 to the first message of /clock, if the time was requested before. Time
    stamps of messages are ROS time: take them from :meth:`stamp`. ``jumps`` counts the jumps of simulated time,
    ``last_jump`` is the newest, s.

    One rclpy timer serves all timers, set to the earliest. While time is not simulated, it is one of the steady clock:
    one of the system's clock would wait for an hour more when that is set back by an hour.
    """

    def __init__(self, runtime: ClockHost) -> None:
        self._runtime = runtime
        self._ros_clock = runtime.node.get_clock()
        self._lock = threading.Lock()
        self._wall = time.time_ns() - time.monotonic_ns()
        self._offset = 0  # ns
        self._is_jumping = False
        self.jumps = 0
        self.last_jump = 0.0
        self._is_simulated = self._ros_clock.ros_time_is_active
        self._start = self._last = self._raw()
        self._began = not self._is_simulated
        self._asked = False
        self._timers = TimerQueue()
        self.timer: Any = None
        """rclpy's timer."""
        self._set_clock_of_timer()
        threshold = JumpThreshold(
            min_forward=Duration(nanoseconds=_LONGEST_STEP),
            min_backward=Duration(nanoseconds=-1),
            on_clock_change=True,
        )
        self._jump_handle = self._ros_clock.create_jump_callback(
            threshold, pre_callback=self._before_jump, post_callback=self._after_jump
        )

    def now(self) -> float:
        """Time in seconds; never goes back."""
        self._runtime.simulated_time.take_newest()
        now = self._now()
        self._asked = True
        return now / _NANOSECONDS

    def stamp(self) -> Time:
        """Return the present ROS time, for the header of a message."""
        self._runtime.simulated_time.take_newest()
        return self._ros_clock.now().to_msg()

    def call_at(self, when: float, callback: Callable[[], None]) -> Timer:
        """As in :class:`Clock`; from any thread."""
        with self._lock:
            timer = self._timers.add(when, callback)
            is_earliest = self._timers.is_first(timer)
        if is_earliest:
            if self._runtime.on_executor_thread:
                self._set_timer()
            else:
                self._runtime.post(self._set_timer)
        return timer

    def wall_seconds(self, when: float) -> float | None:
        """As in :class:`Clock`; None under simulated time."""
        return None if self._ros_clock.ros_time_is_active else when - self.now()

    def _now(self) -> int:
        with self._lock:  # reading inside the lock: two threads must not take each other for a jump
            is_simulated, raw = self._ros_clock.ros_time_is_active, self._raw()
            is_other = is_simulated is not self._is_simulated
            if is_other:
                self._is_simulated, self._start, self._began = is_simulated, raw, not is_simulated
            begins = raw != self._start and not self._began
            leaps = self._is_jumping and raw > self._last + _LONGEST_STEP
            if is_other or raw < self._last or (self._asked if begins else leaps):
                self._offset += self._last - raw
            self._began = self._began or begins
            self._last = raw
            return int(raw + self._offset)

    def _before_jump(self) -> None:
        self._now()  # the last moment at which the time before the jump can be read
        self._is_jumping = True

    def _after_jump(self, jump: TimeJump) -> None:
        began = self._began
        self._now()
        self._is_jumping = False
        if began and int(jump.clock_change) == ClockChange.ROS_TIME_NO_CHANGE:
            self.last_jump = jump.delta.nanoseconds / _NANOSECONDS
            self.jumps += 1
        self._runtime.post(self._set_timer)

    def _raw(self) -> int:
        if self._ros_clock.ros_time_is_active:
            return int(self._ros_clock.now().nanoseconds)
        return time.monotonic_ns() + self._wall

    def _set_clock_of_timer(self) -> None:
        node, is_simulated = self._runtime.node, self._ros_clock.ros_time_is_active
        if self.timer is not None:
            if is_simulated is (self.timer.clock is self._ros_clock):
                return
            node.destroy_timer(self.timer)
        clock = self._ros_clock if is_simulated else RclpyClock(clock_type=ClockType.STEADY_TIME)
        self.timer = node.create_timer(_FARTHEST, self._fire, clock=clock)
        self.timer.cancel()

    def _set_timer(self) -> None:
        # What is set is a period, from a time that must not change meanwhile.
        with self._runtime.simulated_time.standing_still():
            self._set_period()

    def _set_period(self) -> None:
        self._set_clock_of_timer()
        now = self._now()
        with self._lock:
            earliest = self._timers.earliest()
        seconds = now / _NANOSECONDS
        when = max(seconds, min(math.inf if earliest is None else earliest, seconds + _FARTHEST))
        # Where a float says a little more than the whole nanoseconds, the timer comes twice.
        self.timer.timer_period_ns = max(1, round(when * _NANOSECONDS) - now)
        self.timer.reset()
        if earliest is None:
            # Only now: rcl wakes the executor at each step of simulated time for a timer whose time has passed, even
            # for one that is canceled.
            self.timer.cancel()
        elif earliest <= seconds:
            self._runtime.post(self._fire)  # simulated time may stand still

    def _fire(self) -> None:
        now = self._now() / _NANOSECONDS
        while True:
            with self._lock:
                due = self._timers.take(now)
            if due is None:
                break
            _, callback = due
            try:
                callback()
            except Exception as error:
                self._runtime.report_fault(error, 'a timer')
        self._set_timer()


# The simulated time of a node, taken from the middleware on request.
#
# rclpy wakes the executor for each message of /clock, some dozens a second; that was most of the load of an idle node.
# The middleware keeps the newest message anyway. It is taken after each wait of the executor, and, on any thread, when
# code reads the time from :class:`RosClock`. It wakes the executor only while a timer waits.
#
# Also the time, simulated or not, for which a node was able to receive messages.

LONGEST_WAIT: Final = 0.2
"""Longest wait of the executor under simulated time, s of wall time. It bounds the age of the time that rclpy's own
clock shows when it is read without a :class:`RosClock`."""

_NANOSECONDS_OF_SECOND: Final = 1_000_000_000


class SimulatedTime:
    """The source of rclpy's clocks: the newest message of /clock. From any thread.

    ``subscription`` is rclpy's own one, which the executor finds; None while only the executor is to take from
    it, or time is not simulated. ``post_fault`` gets the exceptions of callbacks of jumps of time, on the thread that
    reads the time, which may hold any lock, so it must only keep them for later.

    ``refused`` are messages without a valid time, which were dropped; ``last_refused`` is the newest of them.
    """

    def __init__(self, post_fault: Callable[[Exception], object]) -> None:
        self._post_fault = post_fault
        self.subscription: Subscription | None = None
        self.refused = 0
        self.last_refused = Time()
        self._lock = threading.RLock()
        self._stands_still = False

    def take_newest(self) -> None:
        """Take the newest message, if it was not taken yet.

        No effect while another thread does the same, or keeps the time still.
        """
        subscription = self.subscription
        if subscription is None or not self._lock.acquire(blocking=False):
            return
        try:
            if not self._stands_still:  # else it is this thread's own doing: a callback of a jump asks for the time
                self._stands_still = True
                try:
                    self._take(subscription)
                finally:
                    self._stands_still = False
        except InvalidHandle:  # time is not simulated any more, or again by now
            if self.subscription is subscription:
                self.subscription = None
        except Exception as error:
            self._post_fault(error)
        finally:
            self._lock.release()

    @contextlib.contextmanager
    def standing_still(self) -> Iterator[None]:
        """Let only this thread change the simulated time of rclpy's clocks during the block."""
        with self._lock:
            before, self._stands_still = self._stands_still, True
            try:
                yield
            finally:
                self._stands_still = before

    def _take(self, subscription: Subscription) -> None:
        with subscription.handle:
            taken = subscription.handle.take_message(subscription.msg_type, False)
        if taken is None:
            return
        time = taken[0].clock
        if time.sec < 0 or time.nanosec >= _NANOSECONDS_OF_SECOND:
            self.last_refused = time
            self.refused += 1
            return
        subscription.callback(taken[0])


class HandledTime:
    """The time for which a node has been able to receive messages, s, on the executor thread.

    Time counts as far as both the wall's clock and that of the node have gone on from one look of the executor to the
    next. To detect a missing message, take the difference of two such times: others do not count as silent while a
    simulation is paused, while it runs fast on a busy machine, or while the node itself was held up.
    """

    def __init__(self, steady: Clock, ros_clock: ROSClock) -> None:
        self._steady = steady
        self._ros_clock = ros_clock
        self._seen, self._simulated = steady.now(), 0
        self.looked = 0.0
        """Time counted up to the last check for messages, s."""
        self.handled = 0.0
        """Time counted up to the last check whose messages were all handled, s."""

    def sample(self) -> None:
        """Record that the messages so far are about to be handled."""
        now, went_on = self._steady.now(), math.inf
        if self._ros_clock.ros_time_is_active:
            simulated = self._ros_clock.now().nanoseconds
            if simulated == self._simulated:
                # The next message of /clock is under way, or the simulation is paused.
                self._seen = max(self._seen, now - LONGEST_WAIT)
                return
            went_on, self._simulated = max(0, simulated - self._simulated) * 1e-9, simulated
        self.looked += min(now - self._seen, went_on)
        self._seen = now

    def all_handled(self) -> None:
        """Record that all messages up to the last :meth:`sample` are handled."""
        self.handled = self.looked


def watch_clock_publishers(node: Node, on_change: Callable[[], object]) -> None:
    """Call ``on_change`` on the executor thread, within a second, when a publisher of the simulated time appears or
    disappears; never if time is not simulated at this call. Executor thread only.
    """
    for subscription in filter(is_clock_subscription, node.subscriptions):
        callbacks = SubscriptionEventCallbacks(matched=lambda _event: on_change(), use_default_callbacks=False)
        handlers = callbacks.create_event_handlers(
            subscription.callback_group, subscription.handle, subscription.topic_name
        )
        for handler in handlers:
            subscription.event_handlers.append(handler)  # which ends with it
            node.add_waitable(handler)


def is_clock_subscription(subscription: Subscription) -> bool:
    """Return whether rclpy's clocks get the simulated time from this subscription."""
    return isinstance(getattr(subscription.callback, '__self__', None), TimeSource)
