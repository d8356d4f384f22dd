# SPDX-License-Identifier: BSD-3-Clause
"""Timers that wait for a thread to be awake anyway, as far as they may: timer coalescing.

To wake a thread that sleeps costs several times what most timers have to do (what it needs is not in the processor's
caches any more). A timer with a tolerance is called when the thread wakes for something else about that time.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple


class _Timer(NamedTuple):
    earliest: float
    latest: float
    callback: Callable[[], object]


class CoalescedTimers:
    """Timers of one thread, which asks here how long it may sleep, and what is due whenever it wakes."""

    def __init__(self) -> None:
        self._timers: list[_Timer] = []

    def add(self, when: float, tolerance: float, callback: Callable[[], object]) -> None:
        """Have ``callback`` called once: no earlier than ``tolerance`` seconds before ``when``, no later than that
        after it, and in between as soon as the thread is awake."""
        self._timers.append(_Timer(when - tolerance, when + tolerance, callback))

    @property
    def latest(self) -> float:
        """When the thread has to wake up at the latest; math.inf without timers."""
        return min((timer.latest for timer in self._timers), default=math.inf)

    def take_due(self, now: float) -> list[Callable[[], object]]:
        """What may be called at ``now``, in the order of adding; it is not here any more."""
        due = [timer.callback for timer in self._timers if timer.earliest <= now]
        if due:
            self._timers = [timer for timer in self._timers if timer.earliest > now]
        return due
