# SPDX-License-Identifier: BSD-3-Clause
"""The clock of a ROS node as a :class:`flexbt_core.clock.Clock`: simulated time under ``use_sim_time``."""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Callable
from typing import Any, Protocol

from builtin_interfaces.msg import Time
from rclpy.clock import Clock, ClockChange, ClockType, JumpThreshold, TimeJump
from rclpy.duration import Duration

from flexbt_core.clock import Timer, TimerQueue

from .simulated_time import SimulatedTime

_NANOSECONDS = 1_000_000_000
_FARTHEST = 10.0**9
"""Seconds; a timer that is farther away is checked again then. rcl counts nanoseconds in 64 bits."""
_LONGEST_STEP = 86_400 * _NANOSECONDS
"""What simulated time may go on from one message to the next; more is a jump."""


class Host(Protocol):
    """What the clock needs of a :class:`~flexbt_common.runtime.NodeRuntime`."""

    node: Any
    simulated_time: SimulatedTime

    @property
    def on_executor_thread(self) -> bool:
        """Whether the caller is on the executor thread."""

    def post(self, fn: Callable[[], object]) -> None:
        """Run ``fn`` on the executor thread soon."""

    def report_fault(self, error: BaseException, where: str) -> None:
        """Log an exception that the callback of a timer let escape."""


class RosClock:
    """Time of the node in seconds, and timers on it, called on the executor thread.

    The time equals ROS time until the latter jumps back (simulation reset), jumps ahead by a day or more in one
    message (another recording), or a computer's clock is set: such a jump is taken out, so that this time never goes
    back, and whoever waits for two more seconds does so. So is the jump with which simulated time begins, from 0 to the
    first message of /clock, when somebody has asked for the time before. Time stamps of messages are ROS time: take
    them from :meth:`stamp`. ``jumps`` counts the jumps of simulated time, ``last_jump`` is the newest, s.

    One rclpy timer serves all timers, set to the earliest. While time is not simulated, it is one of the steady clock:
    one of the system's clock would wait for an hour more when that is set back by an hour.
    """

    def __init__(self, runtime: Host) -> None:
        self._runtime = runtime
        self._ros_clock = runtime.node.get_clock()
        self._lock = threading.Lock()
        self._wall = time.time_ns() - time.monotonic_ns()
        self._offset = 0  # ns
        self._is_jumping = False
        self.jumps = 0
        self.last_jump = 0.0
        self._last = self._raw()
        self._began = self._last > 0
        self._asked = False
        self._timers = TimerQueue()
        self._timer: Any = None
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
        """The present ROS time, for the header of a message."""
        self._runtime.simulated_time.take_newest()
        return self._ros_clock.now().to_msg()

    def call_at(self, when: float, callback: Callable[[], None]) -> Timer:
        """As in :class:`flexbt_core.clock.Clock`; from any thread."""
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
        """As in :class:`flexbt_core.clock.Clock`; None under simulated time."""
        return None if self._ros_clock.ros_time_is_active else when - self.now()

    def _now(self) -> int:
        with self._lock:  # reading inside the lock: two threads must not take each other for a jump
            raw = self._raw()
            begins = raw > 0 and not self._began
            leaps = self._is_jumping and raw > self._last + _LONGEST_STEP
            if raw < self._last or (self._asked if begins else leaps):
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
        if self._timer is not None:
            if is_simulated is (self._timer.clock is self._ros_clock):
                return
            node.destroy_timer(self._timer)
        clock = self._ros_clock if is_simulated else Clock(clock_type=ClockType.STEADY_TIME)
        self._timer = node.create_timer(_FARTHEST, self._fire, clock=clock)
        self._timer.cancel()

    def _set_timer(self) -> None:
        # What is set is a period, from a time that must not change meanwhile.
        with self._runtime.simulated_time.standing_still():
            self._set_period()

    def _set_period(self) -> None:
        self._set_clock_of_timer()
        now = self._now()
        with self._lock:
            earliest = self._timers.earliest()
        when = min(math.inf if earliest is None else earliest, now / _NANOSECONDS + _FARTHEST)
        # Where a float says a little more than the whole nanoseconds, the timer comes twice.
        self._timer.timer_period_ns = max(1, round(when * _NANOSECONDS) - now)
        self._timer.reset()
        if earliest is None:
            # Only now: rcl wakes the executor at each step of simulated time for a timer whose time has passed, even
            # for one that is canceled.
            self._timer.cancel()

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
