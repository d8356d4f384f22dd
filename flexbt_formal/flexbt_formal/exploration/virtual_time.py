# SPDX-License-Identifier: BSD-3-Clause
"""The time of an exploration: a clock that stands still, and points in time that are distinct from durations.

An engine remembers either points in time or durations. Only the former change as time goes by, and only their order
matters for what can happen. So the clock returns :class:`Instant`, which arithmetic keeps: a point and a duration make
a point, two points a duration.
"""

from __future__ import annotations

from collections.abc import Callable


class Instant(float):
    """A point in time, s."""

    __slots__ = ()

    def __add__(self, other: float) -> Instant:
        return Instant(float.__add__(self, other))

    __radd__ = __add__

    def __sub__(self, other: float) -> float:
        duration = float.__sub__(self, other)
        return duration if isinstance(other, Instant) else Instant(duration)


class VirtualTimer:
    """A callback that is due at some time; None when it is not to be called any more."""

    __slots__ = ('callback', 'when')

    def __init__(self, when: float, callback: Callable[[], None]) -> None:
        self.when = when
        self.callback: Callable[[], None] | None = callback

    def cancel(self) -> None:
        """Have it not called."""
        self.callback = None


class VirtualClock:
    """A clock that advances only on request. For one thread; a state of it can be kept and restored."""

    def __init__(self) -> None:
        self.time = Instant(0.0)
        self.timers: list[VirtualTimer] = []

    def now(self) -> float:
        """Time in seconds, an Instant."""
        return self.time

    def call_at(self, when: float, callback: Callable[[], None]) -> VirtualTimer:
        """As in :class:`Clock`; a timer that is due already waits for the next :meth:`go_to`."""
        timer = VirtualTimer(when, callback)
        self.timers = [*(one for one in self.timers if one.callback is not None), timer]
        return timer

    def wall_seconds(self, when: float) -> float | None:
        """None: no wall time moves this clock."""
        return None

    def next_timer(self) -> float | None:
        """Return when the first timer is due; None when there is none."""
        return min((one.when for one in self.timers if one.callback is not None), default=None)

    def is_due(self, when: float | None) -> bool:
        """Return whether this time has come."""
        return when is not None and when <= self.time

    def go_to(self, when: float) -> None:
        """Go on to a time, if it is not past, and call what is due by then, in order."""
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
