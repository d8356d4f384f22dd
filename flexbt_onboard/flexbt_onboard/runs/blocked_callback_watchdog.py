# SPDX-License-Identifier: BSD-3-Clause
"""The watchdog for callbacks that block a run.

The thread of the run calls the callbacks of all states, and is blocked until they return. The engine publishes which
callback it is calling, and the watchdog checks that periodically from another thread.
"""

from __future__ import annotations

import threading
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

from flexbt_core.clock.clock import Clock, Timer
from flexbt_core.state_machine.engine.engine import RunningCallback

LIMIT: Final = 1.0
"""Time after which a callback is reported as blocked, s of wall time."""

_PERIOD: Final = 0.5


@dataclass(frozen=True)
class BlockedCallback:
    """A callback that has not returned for some time.

    ``path`` is that of its state, '' for the behavior itself. ``callback`` is the name, and ``seconds`` the time since
    the call, in seconds of wall time.
    """

    path: str
    callback: str
    seconds: float

    @property
    def who(self) -> str:
        """Owner of the callback, for the operator."""
        return f'state {self.path}' if self.path else 'the behavior'

    def __str__(self) -> str:
        return f'{self.who} has not returned from {self.callback}() for {self.seconds:.1f} s'


class BlockedCallbackWatchdog:
    """A watchdog that checks the callback that ``calling`` returns, within its ``with`` block.

    It calls ``held_up`` once for each callback of each state that exceeds the limit, on the thread of the clock. It
    calls ``returned`` when such a callback has returned.
    """

    def __init__(
        self,
        steady: Clock,
        calling: Callable[[], RunningCallback | None],
        held_up: Callable[[BlockedCallback], None],
        returned: Callable[[BlockedCallback], None],
    ) -> None:
        self._steady = steady
        self._calling = calling
        self._held_up = held_up
        self._returned = returned
        self._told: set[tuple[str, str]] = set()
        self._seen: RunningCallback | None = None  # the call at the last check; _since is the time of its first
        self._since = 0.0
        self._is_shown = False
        self._is_watching = False
        self._timer: Timer | None = None
        self._lock = threading.Lock()

    def __enter__(self) -> BlockedCallbackWatchdog:
        with self._lock:
            self._is_watching = True
            self._arm()
        return self

    def __exit__(self, *_: object) -> None:
        with self._lock:
            self._is_watching = False
            returned = self._observe(None)
            if self._timer is not None:
                self._timer.cancel()
        self._tell_returned(returned)

    @property
    def held(self) -> BlockedCallback | None:
        """Callback that exceeds the limit now; None if no callback does. From any thread."""
        with self._lock:
            returned = self._observe(self._calling() if self._is_watching else None)
            held = self._present()
        self._tell_returned(returned)
        return held if held is not None and held.seconds >= LIMIT else None

    def _arm(self) -> None:
        self._timer = self._steady.call_at(self._steady.now() + _PERIOD, self._check)

    def _check(self) -> None:
        with self._lock:
            if not self._is_watching:
                return
            self._arm()
            returned = self._observe(self._calling())
            held = self._present()
            is_new = held is not None and held.seconds >= LIMIT and (held.path, held.callback) not in self._told
            if held is not None and is_new:
                self._told.add((held.path, held.callback))
                self._is_shown = True
        self._tell_returned(returned)
        if held is not None and is_new:
            self._held_up(held)

    def _observe(self, calling: RunningCallback | None) -> BlockedCallback | None:
        """Note the current call, with the lock held. Return the callback that has returned, if it was reported."""
        if calling is self._seen:
            return None
        returned = self._present() if self._is_shown else None
        self._seen, self._since, self._is_shown = calling, self._steady.now(), False
        return returned

    def _tell_returned(self, returned: BlockedCallback | None) -> None:
        if returned is not None:  # without the lock, since reading the status needs it
            self._returned(returned)

    def _present(self) -> BlockedCallback | None:
        return None if self._seen is None else BlockedCallback(*self._seen, self._steady.now() - self._since)
