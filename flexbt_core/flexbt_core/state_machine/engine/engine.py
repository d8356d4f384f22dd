# SPDX-License-Identifier: BSD-3-Clause
"""The interface of a run that its regions, containers and leaves use, and the wait for a halt."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any, Protocol

from flexbt_core.clock.clock import Clock, Timer
from flexbt_core.state_machine.model.autonomy import Decision, DecisionKind

from .controls import Controls, Pausing
from .events import RunEvent


class Engine(Protocol):
    """The view of a run from its parts. Everything except :meth:`wake` is for the thread of the run.

    ``calling`` is the callback that is being called; other threads read it.
    """

    calling: RunningCallback | None

    @property
    def clock(self) -> Clock:
        """The clock of the run."""

    @property
    def services(self) -> Any:
        """Services that the host provides to the states."""

    @property
    def controls(self) -> Controls:
        """Settings of the operator."""

    @property
    def pausing(self) -> Pausing:
        """Parts of the run that are paused."""

    def wake(self) -> None:
        """Ask the host for a step; from any thread."""

    @property
    def readings(self) -> Mapping[type[RunEvent], Sequence[Callable[[Any], None]]]:
        """The methods of the readers, by the types of the events that they read."""

    def tell(self, event: RunEvent) -> None:
        """Give an event to its readers."""

    def fail(self, message: str) -> None:
        """End the run as an error: it cannot continue."""

    def new_decision(
        self, kind: DecisionKind, path: str, outcome: str, outcomes: tuple[str, ...], required: int, prompt: str
    ) -> Decision:
        """Return a decision with a new id, which the operator was not asked yet."""

    def new_halt_wait(self) -> HaltTimeout:
        """Something to wait with for what is left; the run is woken when its time is over."""

    def count_transition(self, path: str) -> None:
        """Watch for livelocks: something is left."""

    def locked_inside(self, top: str) -> list[str]:
        """Return what is active and locked in a state or machine, itself included."""


RunningCallback = tuple[str, str]
"""One call of a callback of a state: path and name. Compare it by identity: each call is an object of its own. It is
no class, since one is made for each call, and a tuple takes an eighth of the time."""


# Waiting until what was left has halted: it may have something to finish, as a goal to cancel, but not forever.


class HaltTimeout:
    """The wait for one thing at a time to halt: ``timeout`` seconds at most; ``wake`` is called at their end."""

    def __init__(self, steady: Clock, timeout: float, wake: Callable[[], None]) -> None:
        self.timeout = timeout
        self._steady = steady
        self._wake = wake
        self._until: float | None = None
        self._timer: Timer | None = None

    def is_over(self, halting: str | None) -> bool:
        """Return whether to go on, as nothing is ``halting`` or the time is up. The time begins with the first "no"."""
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
