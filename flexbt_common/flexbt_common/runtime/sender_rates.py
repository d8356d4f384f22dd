# SPDX-License-Identifier: BSD-3-Clause
"""How much each sender may send: so that a flood of one is no harm to the others."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable
from typing import Final

__all__ = ['SenderRates']

_SENDERS: Final = 256


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
