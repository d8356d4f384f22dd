# SPDX-License-Identifier: BSD-3-Clause
"""A limit of the executor's time for work that other nodes cause."""

from __future__ import annotations

import contextlib
import math
from collections.abc import Iterator
from typing import Final

from .node_runtime import Runtime


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
        """Return whether the pause was long enough."""
        return self._runtime.steady.now() >= self._rested_at - self.BURST_SECONDS

    @contextlib.contextmanager
    def work(self) -> Iterator[None]:
        """Measure the work in the block."""
        began = self._runtime.steady.now()
        try:
            yield
        finally:
            now = self._runtime.steady.now()
            self._rested_at = max(self._rested_at, now) + self.RESTS * (now - began)
            if not self.is_over():  # the executor is woken when they may go on
                self._runtime.call_near(self._rested_at - self.BURST_SECONDS, self.BURST_SECONDS / 10.0, lambda: None)
