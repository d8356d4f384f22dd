# SPDX-License-Identifier: BSD-3-Clause
"""Clocks and their timers. Code gets its clock as an object, so that a test can control the time.

A clock returns the time in seconds and calls back at a given time. This module does not use ROS; the clock of a ROS
node (also with simulated time) is in ``ros_clock``.
"""

from __future__ import annotations

import heapq
import itertools
import logging
import math
import threading
import time
from collections.abc import Callable
from typing import Final, Protocol

_logger = logging.getLogger(__name__)

_LOOKS: Final = 10
_LOOK_SECONDS: Final = 0.001


class Timer(Protocol):
    """A callback that is due at some time."""

    def cancel(self) -> None:
        """Prevent the callback from starting. Does nothing if it has run or was cancelled."""


class Clock(Protocol):
    """A clock in seconds, from an origin that it chooses, with timers."""

    def now(self) -> float:
        """Return the time in seconds."""

    def call_at(self, when: float, callback: Callable[[], None]) -> Timer:
        """Call ``callback`` once, at or after ``when``, which may be in the past. Thread-safe.

        The callback runs on the clock's own thread: it must be short and thread-safe.
        """

    def wall_seconds(self, when: float) -> float | None:
        """Return the wall time until ``when`` in s; None if wall time does not drive this clock. Thread-safe."""


class ManualClock:
    """A clock that moves only when it is advanced, for tests and for stepping.

    The callbacks run on the thread that moves the clock. Thread-safe.
    """

    def __init__(self, start: float = 0.0) -> None:
        self._now = start
        self._timers = TimerQueue()
        self._lock = threading.Lock()

    def now(self) -> float:
        return self._now

    def call_at(self, when: float, callback: Callable[[], None]) -> Timer:
        """Call back as :class:`Clock` does; a timer that is due waits for the next :meth:`advance`, even by 0."""
        with self._lock:
            return self._timers.add(when, callback)

    def wall_seconds(self, when: float) -> float | None:
        return None

    def next_timer(self) -> float | None:
        """Time of the earliest pending callback, or None."""
        with self._lock:
            return self._timers.earliest()

    def advance(self, seconds: float) -> None:
        """Advance by ``seconds`` and run the callbacks that become due in the order of time, each at its own time.

        Callbacks may set further timers; those due within the same step are called in it.
        """
        if seconds < 0.0:
            raise ValueError(f'a clock cannot go back: advance({seconds})')
        self.set(self._now + seconds)

    def set(self, now: float) -> None:
        """Move to the time ``now``: forward like :meth:`advance`, or backward, like simulated time at a reset."""
        while True:
            with self._lock:
                due = self._timers.take(now)
                if due is None:
                    self._now = now
                    return
                when, callback = due
                self._now = max(self._now, when)
            callback()


def seconds_asleep() -> float:
    """Return how long this computer was suspended since boot, in s; :class:`SteadyClock` does not count this time.
    It is accurate to a millisecond, or slightly too low on a very busy computer.

    The two clocks are read one after the other. A third reading detects a delay between them, such as another process.
    """
    most = 0.0
    for _ in range(_LOOKS):
        before = time.monotonic()
        since_boot = time.clock_gettime(time.CLOCK_BOOTTIME)
        after = time.monotonic()
        most = max(most, since_boot - after)
        if after - before < _LOOK_SECONDS:
            break
    return most


def _log_fault(error: BaseException) -> None:
    _logger.error('a callback of the steady clock raised', exc_info=error)


class SteadyClock:
    """The computer's monotonic clock. A daemon thread, started with the first timer, calls back.

    ``on_fault`` is called on that thread with exceptions of callbacks; by default they go to Python's logging.
    """

    def __init__(self, on_fault: Callable[[BaseException], None] = _log_fault) -> None:
        self._on_fault = on_fault
        self._timers = TimerQueue()
        self._condition = threading.Condition()
        self._thread: threading.Thread | None = None
        self._closed = False

    def now(self) -> float:
        return time.monotonic()

    def call_at(self, when: float, callback: Callable[[], None]) -> Timer:
        """Call back as :class:`Clock` does. After :meth:`close` no callback is called.

        Raises:
            RuntimeError: the thread for the first timer could not start; the next timer tries again.
        """
        with self._condition:
            timer = self._timers.add(when, callback)
            if self._closed:
                self._timers.clear()
            elif self._thread is None:
                thread = threading.Thread(target=self._run, name='steady_clock', daemon=True)
                thread.start()
                self._thread = thread
            elif self._timers.is_first(timer):
                self._condition.notify()
        return timer

    def wall_seconds(self, when: float) -> float | None:
        return when - time.monotonic()

    def close(self) -> None:
        """Drop all timers and end the thread. May be called repeatedly, and from a callback."""
        with self._condition:
            self._closed = True
            self._timers.clear()
            self._condition.notify()
            thread = self._thread
        if thread is not None and thread is not threading.current_thread():
            thread.join()

    def _run(self) -> None:
        while True:
            with self._condition:
                due = None
                while not self._closed and (due := self._timers.take(time.monotonic())) is None:
                    when = self._timers.earliest()
                    # A wait is limited to TIMEOUT_MAX; a timer at infinity is never due.
                    self._condition.wait(
                        None if when is None else min(max(when - time.monotonic(), 0.0), threading.TIMEOUT_MAX)
                    )
                if due is None:
                    return
            _, callback = due
            try:
                callback()
            except BaseException as error:
                # A callback that raises, SystemExit too, must not stop the timers of others.
                self._on_fault(error)


# The timers of a clock, in the order of their times.

_FEW: Final = 64
"""Number of timers up to which cancelled ones are kept."""


class QueuedTimer:
    """One entry of a queue. Entries of the same time are called in the order of adding."""

    __slots__ = ('callback', 'sequence', 'when')

    def __init__(self, when: float, sequence: int, callback: Callable[[], object]) -> None:
        self.when = when
        self.sequence = sequence
        self.callback: Callable[[], object] | None = callback

    def __lt__(self, other: QueuedTimer) -> bool:
        return (self.when, self.sequence) < (other.when, other.sequence)

    def cancel(self) -> None:
        """Cancel the timer. Callable from any thread, without a lock."""
        self.callback = None


class TimerQueue:
    """A queue of pending timers. The clock holds its lock for all calls except :meth:`QueuedTimer.cancel`.

    Most timers are cancelled long before their time, such as that of an interrupted sleep. They are removed when the
    queue has grown to twice its size after the last removal.
    """

    def __init__(self) -> None:
        self._heap: list[QueuedTimer] = []
        self._sequence = itertools.count()
        self._limit = _FEW

    def __len__(self) -> int:
        """Return the number of kept timers, including cancelled ones."""
        return len(self._heap)

    def add(self, when: float, callback: Callable[[], object]) -> QueuedTimer:
        """Add a timer that calls ``callback`` at ``when``.

        Raises:
            ValueError: ``when`` is NaN.
        """
        if math.isnan(when):
            raise ValueError('a timer cannot be set for time NaN; give seconds on the clock, as now() does')
        if len(self._heap) >= self._limit:
            self._heap = [timer for timer in self._heap if timer.callback is not None]
            heapq.heapify(self._heap)
            self._limit = max(_FEW, 2 * len(self._heap))
        timer = QueuedTimer(when, next(self._sequence), callback)
        heapq.heappush(self._heap, timer)
        return timer

    def is_first(self, timer: QueuedTimer) -> bool:
        """Return whether no timer is due before this one."""
        return self._heap[0] is timer

    def earliest(self) -> float | None:
        """Return the time of the first timer, or None."""
        while self._heap and self._heap[0].callback is None:
            heapq.heappop(self._heap)
        return self._heap[0].when if self._heap else None

    def take(self, now: float) -> tuple[float, Callable[[], object]] | None:
        """Remove the first timer that is due at ``now``, and return its time and callback; None if none is due."""
        while self._heap and self._heap[0].when <= now:
            timer = heapq.heappop(self._heap)
            callback, timer.callback = timer.callback, None
            if callback is not None:
                return timer.when, callback
        return None

    def clear(self) -> None:
        """Drop all timers."""
        self._heap.clear()
