# SPDX-License-Identifier: BSD-3-Clause
"""The timers of a clock, in the order of their times."""

from __future__ import annotations

import heapq
import itertools
import math
from collections.abc import Callable
from typing import Final

_FEW: Final = 64
"""So many timers are kept in any case, cancelled or not."""


class QueuedTimer:
    """One entry of a queue. Entries of the same time are called in the order of asking."""

    __slots__ = ('callback', 'sequence', 'when')

    def __init__(self, when: float, sequence: int, callback: Callable[[], None]) -> None:
        self.when = when
        self.sequence = sequence
        self.callback: Callable[[], None] | None = callback

    def __lt__(self, other: QueuedTimer) -> bool:
        return (self.when, self.sequence) < (other.when, other.sequence)

    def cancel(self) -> None:
        """From any thread, with no lock held."""
        self.callback = None


class TimerQueue:
    """Timers that wait. For everything but :meth:`QueuedTimer.cancel`, the clock holds a lock of its own.

    Most timers are cancelled long before their time: the end of a sleep that something ended sooner. They are thrown
    out whenever the queue has grown to twice of what was left the last time.
    """

    def __init__(self) -> None:
        self._heap: list[QueuedTimer] = []
        self._sequence = itertools.count()
        self._limit = _FEW

    def __len__(self) -> int:
        """How many are kept, including cancelled ones."""
        return len(self._heap)

    def add(self, when: float, callback: Callable[[], None]) -> QueuedTimer:
        """Have ``callback`` called at ``when``.

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
        """Whether nothing is due before this timer."""
        return self._heap[0] is timer

    def earliest(self) -> float | None:
        """The time of the first timer, or None."""
        while self._heap and self._heap[0].callback is None:
            heapq.heappop(self._heap)
        return self._heap[0].when if self._heap else None

    def take(self, now: float) -> tuple[float, Callable[[], None]] | None:
        """The first timer that is due at ``now``: its time, and what is to be called."""
        while self._heap and self._heap[0].when <= now:
            timer = heapq.heappop(self._heap)
            callback, timer.callback = timer.callback, None
            if callback is not None:
                return timer.when, callback
        return None

    def clear(self) -> None:
        """Forget all timers."""
        self._heap.clear()
