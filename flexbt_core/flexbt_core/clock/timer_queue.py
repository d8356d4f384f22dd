# SPDX-License-Identifier: BSD-3-Clause
"""The alarms of a clock, in the order of their times."""

from __future__ import annotations

import heapq
import itertools
import math
from collections.abc import Callable
from typing import Final

_FEW: Final = 64
"""So many alarms are kept in any case, cancelled or not."""


class Alarm:
    """One entry of a queue. Entries of the same time are called in the order of asking."""

    __slots__ = ('callback', 'sequence', 'when')

    def __init__(self, when: float, sequence: int, callback: Callable[[], None]) -> None:
        self.when = when
        self.sequence = sequence
        self.callback: Callable[[], None] | None = callback

    def __lt__(self, other: Alarm) -> bool:
        return (self.when, self.sequence) < (other.when, other.sequence)

    def cancel(self) -> None:
        """From any thread, with no lock held."""
        self.callback = None


class AlarmQueue:
    """Alarms that wait. For everything but :meth:`Alarm.cancel`, the clock holds a lock of its own.

    Most alarms are cancelled long before their time: the end of a sleep that something ended sooner. They are thrown
    out whenever the queue has grown to twice of what was left the last time.
    """

    def __init__(self) -> None:
        self._heap: list[Alarm] = []
        self._sequence = itertools.count()
        self._limit = _FEW

    def __len__(self) -> int:
        """How many are kept, including cancelled ones."""
        return len(self._heap)

    def add(self, when: float, callback: Callable[[], None]) -> Alarm:
        """Have ``callback`` called at ``when``.

        Raises:
            ValueError: ``when`` is NaN.
        """
        if math.isnan(when):
            raise ValueError('an alarm cannot be set for time NaN; give seconds on the clock, as now() does')
        if len(self._heap) >= self._limit:
            self._heap = [alarm for alarm in self._heap if alarm.callback is not None]
            heapq.heapify(self._heap)
            self._limit = max(_FEW, 2 * len(self._heap))
        alarm = Alarm(when, next(self._sequence), callback)
        heapq.heappush(self._heap, alarm)
        return alarm

    def is_first(self, alarm: Alarm) -> bool:
        """Whether nothing is due before this alarm."""
        return self._heap[0] is alarm

    def earliest(self) -> float | None:
        """The time of the first alarm, or None."""
        while self._heap and self._heap[0].callback is None:
            heapq.heappop(self._heap)
        return self._heap[0].when if self._heap else None

    def take(self, now: float) -> tuple[float, Callable[[], None]] | None:
        """The first alarm that is due at ``now``: its time, and what is to be called."""
        while self._heap and self._heap[0].when <= now:
            alarm = heapq.heappop(self._heap)
            callback, alarm.callback = alarm.callback, None
            if callback is not None:
                return alarm.when, callback
        return None

    def clear(self) -> None:
        """Forget all alarms."""
        self._heap.clear()
