# SPDX-License-Identifier: BSD-3-Clause
"""What regions, containers and leaves need of the run that they are part of."""

from __future__ import annotations

from typing import Any, Protocol

from flexbt_core.clock import Clock
from flexbt_core.state_machine.model import Decision, DecisionKind

from .calling import Calling
from .controls import Controls
from .halt_wait import HaltWait
from .monitor import RunMonitor
from .observer import RunObserver
from .pausing import Pausing


class Engine(Protocol):
    """A run, seen from below. All of it but :meth:`wake` is for the thread of the run.

    ``calling`` is the callback that is being called; other threads look at it.
    """

    calling: Calling | None

    @property
    def clock(self) -> Clock:
        """The clock of the run."""

    @property
    def services(self) -> Any:
        """What whoever runs the machine provides to its states."""

    @property
    def observer(self) -> RunObserver:
        """Who watches the run."""

    @property
    def monitor(self) -> RunMonitor | None:
        """Who checks the run."""

    @property
    def controls(self) -> Controls:
        """What the operator has set."""

    @property
    def pausing(self) -> Pausing:
        """What stands still."""

    def wake(self) -> None:
        """Ask the host for a step; from any thread."""

    def changed(self) -> None:
        """Tell the observer that what the operator is shown has changed."""

    def fault(self, path: str, text: str) -> None:
        """Tell the observer of a fault."""

    def fail(self, message: str) -> None:
        """End the run as an error: there is no way to go on."""

    def new_decision(
        self, kind: DecisionKind, path: str, outcome: str, outcomes: tuple[str, ...], required: int, prompt: str
    ) -> Decision:
        """A decision with an id of its own."""

    def new_halt_wait(self) -> HaltWait:
        """Something to wait with for what is left; the run is woken when its time is over."""

    def count_transition(self, path: str) -> None:
        """Watch for livelocks: something is left."""

    def locked_inside(self, top: str) -> list[str]:
        """What is active and locked in a state or machine, itself included."""
