# SPDX-License-Identifier: BSD-3-Clause
"""Observers and monitors of a run, and the part of the run that a monitor sees."""

from __future__ import annotations

import logging
from collections.abc import Mapping, Sequence
from typing import Final, Protocol

from flexbt_core.clock.clock import Clock
from flexbt_core.state_machine.model.autonomy import Decision
from flexbt_core.state_machine.model.definition import MachineDefinition
from flexbt_core.state_machine.model.event_state import ExitReason
from flexbt_core.state_machine.model.state_host import Severity

from .controls import Controls, Pausing

_logger = logging.getLogger(__name__)

_LEVELS: Final = {
    Severity.DEBUG: logging.DEBUG,
    Severity.INFO: logging.INFO,
    Severity.HINT: logging.INFO,
    Severity.WARN: logging.WARNING,
    Severity.ERROR: logging.ERROR,
}


class RunObserver(Protocol):
    """Hears of a run, on the thread of the run; lines of states may come from any thread."""

    def changed(self) -> None:
        """Something that the operator is shown has changed."""

    def log(self, severity: Severity, path: str, text: str) -> None:
        """A line for the operator."""

    def fault(self, path: str, text: str) -> None:
        """A state raised, or did not halt."""

    def transition(self, path: str, outcome: str, target: str, reason: ExitReason) -> None:
        """A state or machine was left.

        ``target`` is the path of what follows, ``=OUTCOME`` of the machine around it, or '' for a child of a
        concurrency container which goes on without it. One that is repeated has no outcome, and follows itself.
        """


class LoggingObserver:
    """Writes what a run tells to the log of Python: each transition as INFO, faults as ERROR."""

    def changed(self) -> None:
        """Nothing to write: what changed is told by the rest."""

    def log(self, severity: Severity, path: str, text: str) -> None:
        _logger.log(_LEVELS[severity], '%s: %s', path, text)

    def fault(self, path: str, text: str) -> None:
        _logger.error('%s: %s', path, text)

    def transition(self, path: str, outcome: str, target: str, reason: ExitReason) -> None:
        _logger.info('%s > %s, %s', path, outcome or '(again)', reason.value)


# Who checks a run while it goes on, and what of the run it sees.


class MonitoredState(Protocol):
    """A state that is active, or halts."""

    @property
    def path(self) -> str:
        """Where it is in the machine."""

    @property
    def is_entered(self) -> bool:
        """Whether ``on_exit`` is owed to it."""

    def halting(self) -> str | None:
        """Return what has not halted yet since it was left; None when everything has."""


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
        """Return the states that are active."""

    def approved(self) -> Mapping[str, str]:
        """Return what the operator has allowed and has not happened yet: outcomes, by the paths of what is left by
        them."""


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
        """Return when :meth:`rests` is to be called next at the latest, on the clock of the run."""

    def ends(self) -> None:
        """The run is being left for good: nothing may be entered any more."""

    def ended(self, outcome: str) -> None:
        """The run has ended, and everything has halted, or nobody waits for it any more."""
