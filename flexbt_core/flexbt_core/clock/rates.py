# SPDX-License-Identifier: BSD-3-Clause
"""Rate limits for actions and reports. ``now`` is a clock, in seconds."""

from __future__ import annotations

import math
import threading
from collections import OrderedDict
from collections.abc import Callable, Hashable
from typing import Final

_KINDS: Final = 256
"""Maximum number of remembered senders or kinds of reports; the oldest ones are dropped."""


class TokenBucket:
    """A token bucket: ``rate`` per second on average, and ``burst`` at once after a quiet time."""

    def __init__(self, rate: float, burst: float, now: Callable[[], float]) -> None:
        self._rate = rate
        self._burst = self._left = burst
        self._now = now
        self._at = now()

    @property
    def left(self) -> float:
        """Amount available now; negative if more was taken than available."""
        now = self._now()
        self._left = min(self._burst, self._left + (now - self._at) * self._rate)
        self._at = now
        return self._left

    def take(self, amount: float) -> None:
        """Take ``amount``, even if less is available."""
        self._left -= amount


class SenderRates:
    """A rate limit per sender: ``rate`` messages per second on average, and ``burst`` at once after a quiet time."""

    def __init__(self, rate: float, burst: int, now: Callable[[], float]) -> None:
        self._limit = rate, float(burst), now
        self._buckets: OrderedDict[bytes, TokenBucket] = OrderedDict()

    def allows(self, sender: bytes) -> bool:
        """Return whether a message of a sender is within its rate, and count it if so."""
        bucket = self._buckets.get(sender) or TokenBucket(*self._limit)
        self._buckets[sender] = bucket
        self._buckets.move_to_end(sender)
        if len(self._buckets) > _KINDS:
            self._buckets.popitem(last=False)
        is_allowed = bucket.left >= 1.0
        if is_allowed:
            bucket.take(1.0)
        return is_allowed


class RepeatedReports:
    """A filter that passes one report of each kind per ``seconds`` and counts the held ones. Thread-safe."""

    def __init__(self, seconds: float, now: Callable[[], float]) -> None:
        self._seconds = seconds
        self._now = now
        self._lock = threading.Lock()
        self._passed: OrderedDict[Hashable, tuple[float, int]] = OrderedDict()  # time, and number held since

    def held_before(self, kind: Hashable = '') -> int | None:
        """Return the number of reports of this kind held since the last passed one; None if this one is held."""
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
