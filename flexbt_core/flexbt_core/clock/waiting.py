# SPDX-License-Identifier: BSD-3-Clause
"""Waiting for work: a wake event for a worker thread, and timers that fire when their thread is awake anyway."""

from __future__ import annotations

import math
import threading
from collections.abc import Callable
from typing import Final, NamedTuple

from .clock import Clock

_NEAR: Final = 0.5
"""Longest sleep without a timer, s: the waiting thread then reads the clock again, in case it was set."""


class WakeEvent:
    """An event that any thread sets and one waits for. If set while nothing waits, the next wait returns at once."""

    def __init__(self) -> None:
        self._condition = threading.Condition()
        self._is_set = False

    def set(self) -> None:
        """Wake the waiting thread."""
        with self._condition:
            self._is_set = True
            self._condition.notify()

    def take(self) -> bool:
        """Return whether the event was set; it is clear again then."""
        with self._condition:
            was_set, self._is_set = self._is_set, False
        return was_set

    def wait(self, clock: Clock, until: float | None) -> None:
        """Sleep until the event is set or ``clock`` shows ``until`` (None: no time); it is clear again then."""
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


# Timers that wait for a thread to be awake anyway, as far as they may: timer coalescing.
#
# To wake a thread that sleeps costs several times what most timers have to do (what it needs is not in the processor's
# caches any more). A timer with a tolerance is called when the thread wakes for something else about that time.


class _Timer(NamedTuple):
    earliest: float
    latest: float
    callback: Callable[[], object]


class CoalescedTimers:
    """The timers of one thread, which gets from here how long it may sleep, and what is due when it wakes."""

    def __init__(self) -> None:
        self._timers: list[_Timer] = []

    def add(self, when: float, tolerance: float, callback: Callable[[], object]) -> None:
        """Have ``callback`` called once: no earlier than ``tolerance`` seconds before ``when``, no later than that
        after it, and in between as soon as the thread is awake."""
        self._timers.append(_Timer(when - tolerance, when + tolerance, callback))

    @property
    def latest(self) -> float:
        """Latest time at which the thread has to wake up; math.inf without timers."""
        return min((timer.latest for timer in self._timers), default=math.inf)

    def take_due(self, now: float) -> list[Callable[[], object]]:
        """Return what may be called at ``now``, in the order of adding; it is not here any more."""
        due = [timer.callback for timer in self._timers if timer.earliest <= now]
        if due:
            self._timers = [timer for timer in self._timers if timer.earliest > now]
        return due
