# SPDX-License-Identifier: BSD-3-Clause
"""Coming to rest: what was left may have something to finish, such as a goal to cancel, but not for ever."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

from flexbt_core.clock import Clock, Timer

EXIT_TIMEOUT: Final = 3.0
"""How long a state that was left may take to come to rest, s."""


class RestWait:
    """The wait for one thing at a time to be at rest: ``timeout`` seconds at most; ``ring`` is called at their end."""

    def __init__(self, steady: Clock, timeout: float, ring: Callable[[], None]) -> None:
        self.timeout = timeout
        self._steady = steady
        self._ring = ring
        self._until: float | None = None
        self._alarm: Timer | None = None

    def is_over(self, unsettled: str | None) -> bool:
        """Whether to go on, as nothing is ``unsettled`` or the time is up. The time begins with the first "no"."""
        if unsettled is not None:
            if self._until is None:
                self._until = self._steady.now() + self.timeout
                self._alarm = self._steady.call_at(self._until, self._ring)
            if self._steady.now() < self._until:
                return False
        self.cancel()
        return True

    def cancel(self) -> None:
        """Wait no more; the next wait has its full time again."""
        self._until = None
        if self._alarm is not None:
            self._alarm.cancel()
            self._alarm = None
