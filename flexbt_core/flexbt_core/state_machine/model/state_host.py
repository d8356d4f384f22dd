# SPDX-License-Identifier: BSD-3-Clause
"""The services of a run that a state sees: its host, its clock, and the progress that it reports."""

from __future__ import annotations

import math
import threading
from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum
from typing import Any, Protocol

from flexbt_core.clock.clock import Clock, Timer


class Severity(Enum):
    """Weight of a line for the operator; the values are the constants of ExecutiveLog."""

    DEBUG = 1
    INFO = 2
    HINT = 3
    WARN = 4
    ERROR = 5


class StateHost(Protocol):
    """The place of a state in its run. A state is bound to one from before on_start until after on_stop."""

    @property
    def path(self) -> str:
        """Path of the state in its run, as in ``/Outer/Inner``."""

    @property
    def outcome(self) -> str | None:
        """The outcome by which the state is to be left, be it the state that wants it or the operator; None to stay."""

    @property
    def clock(self) -> Clock:
        """The clock of the run, which stands still while the state is paused."""

    @property
    def services(self) -> Any:
        """Services that the host provides to the states."""

    def wake(self) -> None:
        """Execute the state soon; from any thread."""

    def wake_at(self, time: float) -> None:
        """Execute the state at a time of its clock, too."""

    def ask(self, prompt: str, suggestion: str | None) -> None:
        """Let the operator choose the outcome."""

    def log(self, severity: Severity, text: str) -> None:
        """Tell the operator something; from any thread."""


# The clock that a state sees: that of the run, but it stands still while the state is paused.


class StateClock:
    """Time in seconds. It is behind the clock of the run by what the state was paused since it was entered.

    ``stop``, ``go_on`` and ``catch_up`` are for the thread of the run, the rest for any.
    """

    def __init__(self, base: Clock) -> None:
        self.base = base
        self.behind = 0.0
        self._stopped_at: float | None = None
        self._timers: list[_PausableTimer] = []  # that were due while it stood still
        self._lock = threading.Lock()

    def now(self) -> float:
        """Time in seconds."""
        stopped_at = self._stopped_at
        return self.base.now() - self.behind if stopped_at is None else stopped_at

    def call_at(self, when: float, callback: Callable[[], None]) -> Timer:
        """As in :class:`Clock`; what is due while the state is paused is called afterwards."""
        timer = _PausableTimer(self, when, callback)
        timer.set()
        return timer

    def wall_seconds(self, when: float) -> float | None:
        """Return None: it is not known how long it will stand still."""
        return None

    def on_base(self, when: float) -> float:
        """Return the time of the run's clock at which it will be ``when`` here, or just after it, when nothing is
        paused."""
        time = when + self.behind
        while time - self.behind < when:  # rounded down; it would not be time yet, and never become so
            time = math.nextafter(time, math.inf)
        return time

    @property
    def is_behind(self) -> bool:
        """True if it shows another time than the run, or stands still."""
        return self.behind != 0.0 or self._stopped_at is not None

    def stop(self) -> None:
        """Stand still."""
        self._stopped_at = self.now()

    def go_on(self) -> None:
        """Go on where it stood still."""
        if self._stopped_at is None:
            return
        self.behind = self.base.now() - self._stopped_at
        with self._lock:
            self._stopped_at = None
            timers, self._timers = self._timers, []
        for timer in timers:
            timer.set()

    def catch_up(self) -> None:
        """Show the time of the run again."""
        self.go_on()
        self.behind = 0.0

    def keep(self, timer: _PausableTimer) -> bool:
        """Keep a timer that is due until the clock goes on; False when it goes."""
        with self._lock:
            if self._stopped_at is None:
                return False
            self._timers.append(timer)
            return True


class _PausableTimer:
    def __init__(self, clock: StateClock, when: float, callback: Callable[[], None]) -> None:
        self._clock = clock
        self._when = when
        self._callback = callback
        self._behind = 0.0
        self._timer: Timer | None = None
        self._is_cancelled = False

    def set(self) -> None:
        """Have it called when it is due, unless the clock stands still in between."""
        self._behind = self._clock.behind
        self._timer = self._clock.base.call_at(self._clock.on_base(self._when), self._due)

    def cancel(self) -> None:
        self._is_cancelled = True
        if self._timer is not None:
            self._timer.cancel()

    def _due(self) -> None:
        if self._is_cancelled or self._clock.keep(self):
            return
        if self._clock.behind > self._behind:
            self.set()
        else:
            self._callback()


# How far what a state does has come, as figures for the operator.


@dataclass(frozen=True)
class Progress:
    """The progress of a state's work; what it does not know is negative, '' or None.

    ``tree_run_id`` names the run of the tree that works for it; ``distance`` in m, ``time`` in s and ``poses`` (goal
    poses) are what is left; ``recoveries`` were started. ``goal`` is where the robot drives to, a PoseStamped.
    """

    tree_run_id: str = ''
    distance: float = -1.0
    time: float = -1.0
    poses: int = -1
    recoveries: int = 0
    goal: Any = None

    @property
    def is_known(self) -> bool:
        """True if there is progress to show besides the tree."""
        return self != Progress(self.tree_run_id)
