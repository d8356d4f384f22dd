# SPDX-License-Identifier: BSD-3-Clause
"""Rate limits for each sender, so that a flood of one does not harm the others."""

from __future__ import annotations

import contextlib
import math
from collections import OrderedDict
from collections.abc import Callable, Iterator
from typing import Final

from .node_runtime import Runtime

_SENDERS: Final = 256


class SenderRates:
    """A limit for each sender: ``rate`` messages a second on average, and ``burst`` at once after a quiet time.

    ``now`` is in seconds. Only a limited number of the most recent senders is remembered.
    """

    def __init__(self, rate: float, burst: int, now: Callable[[], float]) -> None:
        self._rate = rate
        self._burst = float(burst)
        self._now = now
        self._credits: OrderedDict[bytes, tuple[float, float]] = OrderedDict()  # and when they were counted

    def allows(self, sender: bytes) -> bool:
        """Return whether a message of a sender is within its rate; counts it then."""
        now = self._now()
        credit, since = self._credits.pop(sender, (self._burst, now))
        credit = min(self._burst, credit + (now - since) * self._rate)
        is_allowed = credit >= 1.0
        self._credits[sender] = (credit - 1.0 if is_allowed else credit, now)
        if len(self._credits) > _SENDERS:
            self._credits.popitem(last=False)
        return is_allowed


class Pace:
    """A pace that limits the work in :meth:`work` to a quarter of the executor's time. On the executor thread.

    Subscriptions use it: :meth:`is_over` returns whether they may continue, see ``is_awaited`` of
    :class:`.received_messages.ReceivedMessages`. Meanwhile the middleware keeps the newest messages.
    """

    RESTS: Final = 3.0
    """Seconds of rest for each second of work."""

    BURST_SECONDS: Final = 0.1
    """Rest that may be owed before it is taken, s: occasional messages are not delayed."""

    def __init__(self, runtime: Runtime) -> None:
        self._runtime = runtime
        self._rested_at = -math.inf

    def is_over(self) -> bool:
        """Return whether enough rest was taken."""
        return self._runtime.steady.now() >= self._rested_at - self.BURST_SECONDS

    @contextlib.contextmanager
    def work(self) -> Iterator[None]:
        """Do something in the block."""
        began = self._runtime.steady.now()
        try:
            yield
        finally:
            now = self._runtime.steady.now()
            self._rested_at = max(self._rested_at, now) + self.RESTS * (now - began)
            if not self.is_over():  # the executor is woken when they may go on
                self._runtime.call_near(self._rested_at - self.BURST_SECONDS, self.BURST_SECONDS / 10.0, lambda: None)
