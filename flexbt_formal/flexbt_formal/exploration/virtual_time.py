# SPDX-License-Identifier: BSD-3-Clause
"""The time of an exploration: a clock that advances on request, and points in time that are distinct from durations.

An engine remembers either points in time or durations. Only the former change as time passes, and only their distances
from now affect the possible steps. So the clock returns :class:`Instant`, and arithmetic preserves the type: a point
plus a duration is a point, the difference of two points a duration.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Final

SHORT: Final = 0.0001
"""Time by which an event comes before a timer, s."""
LONG: Final = 1e6
"""Time after which every period is over, s."""
_UNIT: Final = 1e-6
"""Smallest difference in time that distinguishes configurations, s."""


class Instant(float):
    """A point in time, s."""

    __slots__ = ()

    def __add__(self, other: float) -> Instant:
        return Instant(float.__add__(self, other))

    __radd__ = __add__

    def __sub__(self, other: float) -> float:
        duration = float.__sub__(self, other)
        return duration if isinstance(other, Instant) else Instant(duration)


def distance(when: float, now: float) -> float:
    """Return how far a point in time is ahead, in microseconds; 0 only for now. What is long past has one distance."""
    ahead = float.__sub__(when, now)
    if not -LONG < ahead < math.inf:
        return math.copysign(math.inf, ahead)
    return round(ahead / _UNIT) or math.copysign(0.5, ahead) if ahead else 0


class VirtualTimer:
    """A callback that is due at ``when``, s; the callback is None after a call or a cancel."""

    __slots__ = ('callback', 'when')

    def __init__(self, when: float, callback: Callable[[], None]) -> None:
        self.when = when
        self.callback: Callable[[], None] | None = callback

    def cancel(self) -> None:
        """Prevent the call."""
        self.callback = None


class VirtualClock:
    """A clock that advances only on request. For one thread. Its state can be saved and restored."""

    def __init__(self) -> None:
        self.time = Instant(0.0)
        self.timers: list[VirtualTimer] = []

    def now(self) -> float:
        """Return the time in seconds, an Instant."""
        return self.time

    def call_at(self, when: float, callback: Callable[[], None]) -> VirtualTimer:
        """Schedule a call as :class:`Clock` does; a timer that is already due waits for the next :meth:`go_to`."""
        timer = VirtualTimer(when, callback)
        self.timers = [*(one for one in self.timers if one.callback is not None), timer]
        return timer

    def wall_seconds(self, when: float) -> float | None:
        """Return None: wall time does not move this clock."""
        return None

    def next_timer(self) -> float | None:
        """Return the time at which the first timer is due; None without a timer."""
        return min((one.when for one in self.timers if one.callback is not None), default=None)

    def is_due(self, when: float | None) -> bool:
        """Return whether the clock has reached this time."""
        return when is not None and when <= self.time

    def lapse(self, due: float | None) -> None:
        """Advance until just before the time ``due``; None: by a long time."""
        self.go_to(self.time + LONG if due is None else due - SHORT)

    def go_to(self, when: float) -> None:
        """Advance to a time, unless it is past, and call the timers that are due by then, in order."""
        while True:
            due = [one for one in self.timers if one.callback is not None and one.when <= when]
            if not due:
                break
            first = min(due, key=lambda one: one.when)
            self.timers = [one for one in self.timers if one is not first]
            self.time = max(self.time, Instant(first.when))
            assert first.callback is not None
            callback, first.callback = first.callback, None
            callback()
        self.time = max(self.time, Instant(when))
