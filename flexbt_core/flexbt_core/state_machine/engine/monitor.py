# SPDX-License-Identifier: BSD-3-Clause
"""Who checks a run while it goes on, and what of the run it sees."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Protocol

from flexbt_core.clock import Clock
from flexbt_core.state_machine.model import Decision, ExitReason, MachineDefinition

from .controls import Controls
from .pausing import Pausing


class MonitoredState(Protocol):
    """A state that is active, or halts."""

    @property
    def path(self) -> str:
        """Where it is in the machine."""

    @property
    def is_entered(self) -> bool:
        """Whether ``on_exit`` is owed to it."""

    def halting(self) -> str | None:
        """What has not halted yet since it was left; None when everything has."""


class MonitoredRun(Protocol):
    """What a monitor sees of a run."""

    @property
    def definition(self) -> MachineDefinition:
        """The machine; another one after a switch."""

    @property
    def clock(self) -> Clock:
        """The clock of the run."""

    @property
    def controls(self) -> Controls:
        """What the operator has set."""

    @property
    def pausing(self) -> Pausing:
        """What stands still."""

    def active_states(self) -> Sequence[MonitoredState]:
        """The states that are active."""

    def approved(self) -> Mapping[str, str]:
        """What the operator has allowed and has not happened yet: outcomes, by the paths of what is left by them."""


class RunMonitor(Protocol):
    """Is told, on the thread of the run, what happens within its steps; each call has to take next to no time."""

    def begins(self, run: MonitoredRun, is_resumed: bool) -> None:
        """The run begins, or is where another one was, and goes on there; nothing was entered yet."""

    def entered(self, path: str) -> None:
        """``on_enter`` of a state is called next."""

    def exited(self, path: str) -> None:
        """``on_exit`` of a state is called next."""

    def asked(self, decision: Decision) -> None:
        """The operator is asked."""

    def confirmed(self, decision_id: str) -> None:
        """The operator lets what a decision asks for happen."""

    def forced(self, path: str, outcome: str) -> None:
        """The operator wants a state or machine to be left by an outcome."""

    def leaves(self, path: str, outcome: str, required: int) -> None:
        """A state or machine is left next by an outcome that it wants, which requires a level of autonomy."""

    def transition(self, path: str, outcome: str, target: str, reason: ExitReason) -> None:
        """As in :class:`RunObserver`."""

    def rests(self) -> None:
        """Nothing more can happen now."""

    def next_wake(self) -> float | None:
        """When :meth:`rests` is to be called next at the latest, on the clock of the run."""

    def ends(self) -> None:
        """The run is being left for good: nothing may be entered any more."""

    def ended(self, outcome: str) -> None:
        """The run has ended, and everything has halted, or nobody waits for it any more."""
