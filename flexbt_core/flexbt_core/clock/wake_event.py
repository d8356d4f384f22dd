# SPDX-License-Identifier: BSD-3-Clause
"""How a worker thread sleeps until there is something to do: until somebody wakes it, or until a time of a clock."""

from __future__ import annotations

import threading
from typing import Final

from .clock import Clock

_NEAR: Final = 0.5
"""Seconds for which a sleep needs no timer: whoever waits reads the clock again then, should that have been set."""


class WakeEvent:
    """Set from any thread, waited for by one. What is set while nobody waits is kept for the next wait."""

    def __init__(self) -> None:
        self._condition = threading.Condition()
        self._is_set = False

    def set(self) -> None:
        """Wake the one who waits."""
        with self._condition:
            self._is_set = True
            self._condition.notify()

    def wait(self, clock: Clock, until: float | None) -> None:
        """Sleep until the event is set or ``clock`` shows ``until`` (None: no time); it is clear again then."""
        with self._condition:
            while until is not None and not self._is_set:
                seconds = clock.wall_seconds(until)
                if seconds is None or seconds > _NEAR:
                    break
                if seconds <= 0.0:
                    return
                self._condition.wait(seconds)  # wakes nobody else
            if self._is_set:
                self._is_set = False
                return
        timer = clock.call_at(until, self.set) if until is not None else None
        with self._condition:
            self._condition.wait_for(lambda: self._is_set)
            self._is_set = False
        if timer is not None:
            timer.cancel()
