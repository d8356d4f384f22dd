# SPDX-License-Identifier: BSD-3-Clause
"""Clocks of the pure cores: time is an object that is handed in, so that a test can own it.

A clock tells the time in seconds and calls back at a given time. Nothing here knows ROS; the clock of a ROS
node (simulated time included) is in ``ros_clock``.
"""

from __future__ import annotations

import heapq
import itertools
import logging
import math
import threading
import time
from collections.abc import Callable
from typing import Protocol

_logger = logging.getLogger(__name__)


class Timer(Protocol):
    """A callback that is due at some time."""

    def cancel(self) -> None:
        """Makes sure that the callback is not started any more. Harmless when it has run or was cancelled."""


class Clock(Protocol):
    """Time in seconds, from an origin that is the clock's own business, and alarms on it."""

    def now(self) -> float:
        """Time in seconds."""

    def call_at(self, when: float, callback: Callable[[], None]) -> Timer:
        """Calls ``callback`` once, at or after ``when`` (also when that is past already); thread-safe.

        The callback runs on the clock's own thread: it has to be short and thread-safe.
        """

    def wall_seconds(self, when: float) -> float | None:
        """Seconds of wall time until ``when``; None where wall time is not what moves this clock. Thread-safe."""


class _Alarm:
    """One entry of an alarm queue. Entries of the same time are called in the order of asking."""

    __slots__ = ('callback', 'sequence', 'when')

    def __init__(self, when: float, sequence: int, callback: Callable[[], None]) -> None:
        self.when = when
        self.sequence = sequence
        self.callback: Callable[[], None] | None = callback

    def __lt__(self, other: _Alarm) -> bool:
        return (self.when, self.sequence) < (other.when, other.sequence)

    def cancel(self) -> None:
        self.callback = None


def _checked(when: float) -> float:
    if math.isnan(when):
        raise ValueError('an alarm cannot be set for time NaN; give seconds on the clock, as now() does')
    return when


class ManualClock:
    """A clock that stands still until it is told to go on: for tests and for stepping.

    The callbacks run on the thread that moves the clock. Safe to use from several threads.
    """

    def __init__(self, start: float = 0.0) -> None:
        self._now = start
        self._alarms: list[_Alarm] = []
        self._sequence = itertools.count()
        self._lock = threading.Lock()

    def now(self) -> float:
        return self._now

    def call_at(self, when: float, callback: Callable[[], None]) -> Timer:
        """As in :class:`Clock`; an alarm that is due already waits for the next :meth:`advance`, if by 0."""
        with self._lock:
            alarm = _Alarm(_checked(when), next(self._sequence), callback)
            heapq.heappush(self._alarms, alarm)
        return alarm

    def wall_seconds(self, when: float) -> float | None:
        return None

    def next_alarm(self) -> float | None:
        """Time of the earliest callback that is waiting, or None."""
        with self._lock:
            while self._alarms and self._alarms[0].callback is None:
                heapq.heappop(self._alarms)
            return self._alarms[0].when if self._alarms else None

    def advance(self, seconds: float) -> None:
        """Goes on by ``seconds``, calling what becomes due in the order of time, each at its own time.

        Callbacks may set further alarms; those that are due within the same step are called in it.
        """
        if seconds < 0.0:
            raise ValueError(f'a clock cannot go back: advance({seconds})')
        self.set(self._now + seconds)

    def set(self, now: float) -> None:
        """Goes to the time ``now``: forth as :meth:`advance`, or back, as simulated time does at a reset."""
        while True:
            with self._lock:
                if not self._alarms or self._alarms[0].when > now:
                    self._now = now
                    return
                alarm = heapq.heappop(self._alarms)
                callback, alarm.callback = alarm.callback, None
                if callback is not None:
                    self._now = max(self._now, alarm.when)
            if callback is not None:
                callback()


class SteadyClock:
    """The machine's monotonic clock. One daemon thread, started with the first alarm, calls back."""

    def __init__(self) -> None:
        self._alarms: list[_Alarm] = []
        self._sequence = itertools.count()
        self._condition = threading.Condition()
        self._thread: threading.Thread | None = None
        self._closed = False

    def now(self) -> float:
        return time.monotonic()

    def call_at(self, when: float, callback: Callable[[], None]) -> Timer:
        """As in :class:`Clock`. After :meth:`close` nothing is called any more."""
        with self._condition:
            alarm = _Alarm(_checked(when), next(self._sequence), callback)
            if self._closed:
                alarm.cancel()
                return alarm
            heapq.heappush(self._alarms, alarm)
            if self._thread is None:
                self._thread = threading.Thread(target=self._run, name='steady_clock', daemon=True)
                self._thread.start()
            elif self._alarms[0] is alarm:
                self._condition.notify()
        return alarm

    def wall_seconds(self, when: float) -> float | None:
        return when - time.monotonic()

    def close(self) -> None:
        """Drops all alarms and ends the thread. May be called twice, and from a callback."""
        with self._condition:
            self._closed = True
            self._alarms.clear()
            self._condition.notify()
            thread = self._thread
        if thread is not None and thread is not threading.current_thread():
            thread.join()

    def _run(self) -> None:
        while True:
            with self._condition:
                while not self._closed and (not self._alarms or self._alarms[0].when > time.monotonic()):
                    wait = self._alarms[0].when - time.monotonic() if self._alarms else None
                    # A wait takes no more than TIMEOUT_MAX; an alarm at infinity is simply never due.
                    self._condition.wait(None if wait is None else min(max(wait, 0.0), threading.TIMEOUT_MAX))
                if self._closed:
                    return
                alarm = heapq.heappop(self._alarms)
                callback, alarm.callback = alarm.callback, None
            if callback is not None:
                try:
                    callback()
                except Exception:
                    # One faulty callback must not take everybody else's alarms away.
                    _logger.exception('a callback of the steady clock raised')
