# SPDX-License-Identifier: BSD-3-Clause
"""Waiting until what was left has halted: it may have something to finish, as a goal to cancel, but not for ever."""

from __future__ import annotations

from collections.abc import Callable

from flexbt_core.clock import Clock, Timer


class HaltWait:
    """The wait for one thing at a time to halt: ``timeout`` seconds at most; ``wake`` is called at their end."""

    def __init__(self, steady: Clock, timeout: float, wake: Callable[[], None]) -> None:
        self.timeout = timeout
        self._steady = steady
        self._wake = wake
        self._until: float | None = None
        self._timer: Timer | None = None

    def is_over(self, halting: str | None) -> bool:
        """Whether to go on, as nothing is ``halting`` or the time is up. The time begins with the first "no"."""
        if halting is not None:
            if self._until is None:
                self._until = self._steady.now() + self.timeout
                self._timer = self._steady.call_at(self._until, self._wake)
            if self._steady.now() < self._until:
                return False
        if self._until is not None:
            self.cancel()
        return True

    def cancel(self) -> None:
        """Wait no more; the next wait has its full time again."""
        self._until = None
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None
