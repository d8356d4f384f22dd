# SPDX-License-Identifier: BSD-3-Clause
"""The watchdog for callbacks that hold up a run.

The callbacks of all states are called on the thread of the run, which can do nothing else until they return. The engine
says which it calls, and that is checked from outside now and then.
"""

from __future__ import annotations

import threading
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

from flexbt_core.clock.clock import Clock, Timer
from flexbt_core.state_machine.engine.engine import RunningCallback

LIMIT: Final = 1.0
"""Time that a callback may take before it is reported, s of wall time."""

_PERIOD: Final = 0.5


@dataclass(frozen=True)
class BlockedCallback:
    """A callback that takes long: the path of its state ('' for the behavior itself), its name, and for how long now,
    in seconds of wall time."""

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
    """Checks what ``calling`` gives while it is in its ``with`` block.

    ``held_up`` is called once for each callback of each state that takes longer than the limit, on the thread of the
    clock; ``returned`` when one of these has returned.
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
        self._seen: RunningCallback | None = None  # that was seen last, and when it was seen first
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
        """The callback that takes longer than the limit now. From any thread."""
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
        """Note what is called now, with the lock; return the callback that has returned, if it was reported as slow."""
        if calling is self._seen:
            return None
        returned = self._present() if self._is_shown else None
        self._seen, self._since, self._is_shown = calling, self._steady.now(), False
        return returned

    def _tell_returned(self, returned: BlockedCallback | None) -> None:
        if returned is not None:  # without the lock, which who asks for the status needs
            self._returned(returned)

    def _present(self) -> BlockedCallback | None:
        return None if self._seen is None else BlockedCallback(*self._seen, self._steady.now() - self._since)
