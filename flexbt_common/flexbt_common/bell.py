# SPDX-License-Identifier: BSD-3-Clause
"""How a worker thread sleeps until there is something to do: until somebody rings, or until a time of a clock."""

from __future__ import annotations

import threading

from flexbt_common.clock import Clock


class Bell:
    """Rung from any thread, waited for by one. A ring while nobody waits is kept for the next wait."""

    def __init__(self) -> None:
        self._condition = threading.Condition()
        self._rung = False

    def ring(self) -> None:
        """Wake the one who waits."""
        with self._condition:
            self._rung = True
            self._condition.notify()

    def wait(self, clock: Clock, until: float | None) -> None:
        """Sleep until the bell is rung or ``clock`` shows ``until`` (None: no time); takes the ring."""
        with self._condition:
            if self._rung:  # no alarm for nothing
                self._rung = False
                return
        timer = clock.call_at(until, self.ring) if until is not None else None
        with self._condition:
            self._condition.wait_for(lambda: self._rung)
            self._rung = False
        if timer is not None:
            timer.cancel()
