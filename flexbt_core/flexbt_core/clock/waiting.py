# SPDX-License-Identifier: BSD-3-Clause
"""Waiting for work: a wake event for a worker thread, and coalesced timers that fire when their thread is awake."""

from __future__ import annotations

import math
import threading
from collections.abc import Callable
from typing import Final, NamedTuple

from .clock import Clock

_NEAR: Final = 0.5
"""Longest sleep without a timer, s. Then the waiting thread reads the clock again, in case it was set."""


class WakeEvent:
    """An event that any thread sets and one thread waits for. If set before, the next wait returns at once."""

    def __init__(self) -> None:
        self._condition = threading.Condition()
        self._is_set = False

    def set(self) -> None:
        """Wake the waiting thread."""
        with self._condition:
            self._is_set = True
            self._condition.notify()

    def take(self) -> bool:
        """Return whether the event was set, and clear it."""
        with self._condition:
            was_set, self._is_set = self._is_set, False
        return was_set

    def wait(self, clock: Clock, until: float | None) -> None:
        """Sleep until the event is set or ``clock`` shows ``until`` (None: no limit), and clear the event."""
        with self._condition:
            while until is not None and not self._is_set:
                seconds = clock.wall_seconds(until)
                if seconds is None or seconds > _NEAR:
                    break
                if seconds <= 0.0:
                    return
                self._condition.wait(seconds)  # wakes no other thread
            if self._is_set:
                self._is_set = False
                return
        timer = clock.call_at(until, self.set) if until is not None else None
        with self._condition:
            self._condition.wait_for(lambda: self._is_set)
            self._is_set = False
        if timer is not None:
            timer.cancel()


# Timer coalescing: within their tolerance, timers wait until their thread is awake.
#
# Waking a thread costs several times the work of most timers, since its data has left the processor's caches. A timer
# with a tolerance is called when the thread wakes for another reason about that time.


class _Timer(NamedTuple):
    earliest: float
    latest: float
    callback: Callable[[], object]


class CoalescedTimers:
    """The coalesced timers of one thread: how long it may sleep, and what is due when it wakes."""

    def __init__(self) -> None:
        self._timers: list[_Timer] = []

    def add(self, when: float, tolerance: float, callback: Callable[[], object]) -> None:
        """Call ``callback`` once, as soon as the thread is awake within ``tolerance`` seconds before or after ``when``,
        and at the end of that period at the latest."""
        self._timers.append(_Timer(when - tolerance, when + tolerance, callback))

    @property
    def latest(self) -> float:
        """Latest time at which the thread has to wake up; math.inf without timers."""
        return min((timer.latest for timer in self._timers), default=math.inf)

    def take_due(self, now: float) -> list[Callable[[], object]]:
        """Remove and return the callbacks that may be called at ``now``, in the order of adding."""
        due = [timer.callback for timer in self._timers if timer.earliest <= now]
        if due:
            self._timers = [timer for timer in self._timers if timer.earliest > now]
        return due
