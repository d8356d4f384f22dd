# SPDX-License-Identifier: BSD-3-Clause
"""Which callback of which state holds up a run.

The callbacks of all states are called on the thread of the run, which can do nothing else until they return. The thread
is looked at from outside now and then, so that calling them costs nothing more.
"""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import Final

from flexbt_core.clock import Clock, Timer
from flexbt_core.state_machine import CallbackOnThread, callback_on

LIMIT: Final = 1.0
"""A callback that takes longer is told, in seconds of wall time."""

_PERIOD: Final = 0.5


class CallbackWatch:
    """Looks at the thread that is in its ``with`` block.

    ``tell`` gets the path of the state, the name of the callback and the seconds that it has taken at least, once for
    each callback of each state, on the thread of the clock.
    """

    def __init__(self, steady: Clock, tell: Callable[[str, str, float], None]) -> None:
        self._steady = steady
        self._tell = tell
        self._told: set[tuple[str, str]] = set()
        self._seen: CallbackOnThread | None = None  # that was seen last, and when it was seen first
        self._since = 0.0
        self._thread_id = 0
        self._timer: Timer | None = None
        self._lock = threading.Lock()

    def __enter__(self) -> None:
        self._thread_id = threading.get_ident()
        with self._lock:
            self._arm()

    def __exit__(self, *_: object) -> None:
        with self._lock:
            self._thread_id = 0
            self._seen = None
            if self._timer is not None:
                self._timer.cancel()

    def _arm(self) -> None:
        self._timer = self._steady.call_at(self._steady.now() + _PERIOD, self._look)

    def _look(self) -> None:
        with self._lock:
            if not self._thread_id:
                return
            self._arm()
            seen, now = callback_on(self._thread_id), self._steady.now()
            if seen is None or self._seen is None or seen.call is not self._seen.call:
                self._seen, self._since = seen, now
            if seen is None or now - self._since < LIMIT:
                return
            told = seen.path, seen.callback
            if told not in self._told:
                self._told.add(told)
                self._tell(*told, now - self._since)
