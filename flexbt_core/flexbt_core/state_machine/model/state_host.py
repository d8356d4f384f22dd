# SPDX-License-Identifier: BSD-3-Clause
"""The interface between a run and a state: the host, the clock, and the progress report."""

from __future__ import annotations

import math
import threading
from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum
from typing import Any, Final, Protocol

from flexbt_core.clock.clock import Clock, Timer


class Severity(Enum):
    """Severity of a line for the operator; the values are the constants of ExecutiveLog."""

    DEBUG = 1
    INFO = 2
    HINT = 3
    WARN = 4
    ERROR = 5


class StateHost(Protocol):
    """The host of a state in its run. A state is bound to one from before on_start until after on_stop."""

    @property
    def path(self) -> str:
        """Path of the state in its run, as in ``/Outer/Inner``."""

    @property
    def outcome(self) -> str | None:
        """The outcome that the state or the operator wants for the state; None to stay."""

    @property
    def clock(self) -> Clock:
        """The clock of the run, which stops while the state is paused."""

    @property
    def services(self) -> Any:
        """Services of the host for the states."""

    def wake(self) -> None:
        """Execute the state soon. Callable from any thread."""

    def wake_at(self, time: float) -> None:
        """Execute the state also at ``time`` on its clock, in s."""

    def execute_again(self) -> None:
        """Execute the state again, without waiting: in this step, unless it goes on so for too long."""

    def ask(self, prompt: str, suggestion: str | None) -> None:
        """Ask the operator for the outcome."""

    def log(self, severity: Severity, text: str) -> None:
        """Log a line for the operator. Callable from any thread."""


# The clock of a state: that of the run, but it stops while the state is paused.


class StateClock:
    """A clock in seconds, behind that of the run by the paused time since the state was entered.

    Call ``stop``, ``go_on`` and ``catch_up`` on the thread of the run, the rest on any thread.
    """

    def __init__(self, base: Clock) -> None:
        self.base = base
        self.behind = 0.0
        self._stopped_at: float | None = None
        self._timers: list[_PausableTimer] = []  # due while the clock was stopped
        self._lock = threading.Lock()

    def now(self) -> float:
        """Time in seconds."""
        stopped_at = self._stopped_at
        return self.base.now() - self.behind if stopped_at is None else stopped_at

    def call_at(self, when: float, callback: Callable[[], None]) -> Timer:
        """Call back as :class:`Clock` does; a timer that is due while the state is paused is called after the pause."""
        timer = _PausableTimer(self, when, callback)
        timer.set()
        return timer

    def wall_seconds(self, when: float) -> float | None:
        """Return None: the length of future pauses is unknown."""
        return None

    def on_base(self, when: float) -> float:
        """Return the time of the run's clock at which this clock shows ``when``, or just after it, without further
        pauses."""
        time = when + self.behind
        while time - self.behind < when:  # rounded down: the timer would never become due
            time = math.nextafter(time, math.inf)
        return time

    @property
    def is_behind(self) -> bool:
        """True if it shows another time than the run's clock, or is stopped."""
        return self.behind != 0.0 or self._stopped_at is not None

    def stop(self) -> None:
        """Stop the clock."""
        self._stopped_at = self.now()

    def go_on(self) -> None:
        """Continue from the time at which the clock stopped."""
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
        """Keep a due timer until the clock continues. Return False if the clock is not stopped."""
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
        """Set the timer on the run's clock; it is called when due unless the state is paused before."""
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


# Progress of a state, as figures for the operator.

_MOST_POSES: Final = 2**15 - 1
_MOST_RECOVERIES: Final = 2**16 - 1
"""Bounds of the fields of flexbt_msgs/msg/Progress."""


@dataclass(frozen=True)
class Progress:
    """The progress of a state's work; unknown values are negative, '' or None.

    ``tree_run_id`` is the run of the tree that works for the state. ``distance`` (m), ``time`` (s) and ``poses`` (goal
    poses) are the rest of the way; ``recoveries`` counts started recoveries. ``goal`` is a PoseStamped.
    """

    tree_run_id: str = ''
    distance: float = -1.0
    time: float = -1.0
    poses: int = -1
    recoveries: int = 0
    goal: Any = None

    def __post_init__(self) -> None:
        """Give the figures the types and bounds of the message: those of numpy would end the process that sends it.

        Raises TypeError or ValueError if one has no such type.
        """
        figures = {
            'tree_run_id': str(self.tree_run_id),
            'distance': float(self.distance),
            'time': float(self.time),
            'poses': max(-1, min(int(self.poses), _MOST_POSES)),
            'recoveries': max(0, min(int(self.recoveries), _MOST_RECOVERIES)),
        }
        for name, figure in figures.items():
            object.__setattr__(self, name, figure)

    @property
    def is_known(self) -> bool:
        """True if there is progress to show in addition to the tree."""
        return self != Progress(self.tree_run_id)
