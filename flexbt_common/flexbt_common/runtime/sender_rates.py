# SPDX-License-Identifier: BSD-3-Clause
"""How much each sender may send, and how often the same is reported: so that a flood does no harm."""

from __future__ import annotations

import math
import threading
from collections import OrderedDict
from collections.abc import Callable, Hashable
from typing import Final

__all__ = ['RepeatedReports', 'SenderRates']

_SENDERS: Final = 256
_KINDS: Final = 100


class SenderRates:
    """Allows each sender ``rate`` messages a second on average, and ``burst`` at once after a quiet time.

    ``now`` is in seconds. Of the senders that were heard last, only so many are remembered.
    """

    def __init__(self, rate: float, burst: int, now: Callable[[], float]) -> None:
        self._rate = rate
        self._burst = float(burst)
        self._now = now
        self._credits: OrderedDict[bytes, tuple[float, float]] = OrderedDict()  # and when they were counted

    def allows(self, sender: bytes) -> bool:
        """Whether a message of a sender is within its rate; counts it then."""
        now = self._now()
        credit, since = self._credits.pop(sender, (self._burst, now))
        credit = min(self._burst, credit + (now - since) * self._rate)
        is_allowed = credit >= 1.0
        self._credits[sender] = (credit - 1.0 if is_allowed else credit, now)
        if len(self._credits) > _SENDERS:
            self._credits.popitem(last=False)
        return is_allowed


class RepeatedReports:
    """Lets a report of each kind pass once in ``seconds``, and counts those between. From any thread.

    ``now`` is in seconds. Only the newest hundred kinds are remembered.
    """

    def __init__(self, seconds: float, now: Callable[[], float]) -> None:
        self._seconds = seconds
        self._now = now
        self._lock = threading.Lock()
        self._passed: OrderedDict[Hashable, tuple[float, int]] = OrderedDict()  # when, and how many were held since

    def held_before(self, kind: Hashable) -> int | None:
        """Return how many reports of this kind were held since the last one that passed; None if this one is held."""
        now = self._now()
        with self._lock:
            passed_at, held = self._passed.get(kind, (-math.inf, 0))
            if now < passed_at + self._seconds:
                self._passed[kind] = passed_at, held + 1
                return None
            self._passed[kind] = now, 0
            self._passed.move_to_end(kind)
            if len(self._passed) > _KINDS:
                self._passed.popitem(last=False)
            return held
