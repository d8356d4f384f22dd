# SPDX-License-Identifier: BSD-3-Clause
"""The events of a run, and the readers of them.

The engine makes each type of event in one place and passes it to the readers at once, in order. It does so on the
thread of the run, with two exceptions: a state may cause :class:`Logged` on any thread, and :class:`CommandDecided`
for a command after the end comes on the thread of the command.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass
from typing import Any, ClassVar, Final

from flexbt_core.state_machine.model.autonomy import Decision
from flexbt_core.state_machine.model.definition import MachineDefinition
from flexbt_core.state_machine.model.event_state import ExitReason
from flexbt_core.state_machine.model.state_host import Severity


class RunEvent:
    """An event of a run. Events are immutable values."""

    __slots__ = ()


class RunReader:
    """A reader of the events of a run. Reading must take almost no time."""

    reads: ClassVar[Collection[type[RunEvent]]] = ()
    """Types of the events that it reads; () for all types. The engine makes no event without a reader."""

    def read(self, event: RunEvent) -> None:
        """Handle an event."""

    def methods(self) -> Mapping[type[RunEvent], Callable[[Any], None]]:
        """Return the handler for each type of event. Override it to handle each type with a method."""
        return dict.fromkeys(self.reads or RunEvent.__subclasses__(), self.read)

    def next_wake(self) -> float | None:
        """Return the latest time of the next step that this reader needs, on the run's clock; None for no need."""
        return None


# The run as a whole.


@dataclass(slots=True)
class RunStarted(RunEvent):
    """The run begins; no state has been entered yet.

    A run that continues another one is ``is_resumed``. Then the states in ``active`` are active already and are not
    entered again; ``approved`` maps paths to outcomes that the operator has allowed.
    """

    is_resumed: bool
    active: tuple[str, ...]
    approved: Mapping[str, str]


@dataclass(slots=True)
class RunPaused(RunEvent):
    """The operator has paused the run, or resumed it."""

    is_paused: bool


@dataclass(slots=True)
class MachineSwitched(RunEvent):
    """The run continues with another machine; the active states stay active."""

    definition: MachineDefinition


class RunRested(RunEvent):
    """The run is idle until something wakes it."""

    __slots__ = ()


class RunEnding(RunEvent):
    """The run ends: it enters no more states."""

    __slots__ = ()


@dataclass(slots=True)
class HaltAwaited(RunEvent):
    """The end of the run waits for ``text`` to halt; '' when everything has halted."""

    text: str


@dataclass(slots=True)
class RunEnded(RunEvent):
    """The run has ended. Everything has halted, or the run has stopped waiting for it."""

    outcome: str
    message: str


# States and machines, by their paths.


@dataclass(slots=True)
class MachineEntered(RunEvent):
    """A machine or container is entered, at its beginning: its states are entered next. Not for the root."""

    path: str


@dataclass(slots=True)
class StateEntered(RunEvent):
    """A state is entered: its ``on_enter`` is called next."""

    path: str


@dataclass(slots=True)
class StateExited(RunEvent):
    """A state is exited: its ``on_exit`` is called next."""

    path: str


@dataclass(slots=True)
class StatePaused(RunEvent):
    """A state was paused or resumed."""

    path: str
    is_paused: bool


@dataclass(slots=True)
class OutcomeTaken(RunEvent):
    """A state or machine is about to be left by an outcome, which requires a level of autonomy."""

    path: str
    outcome: str
    required: int


@dataclass(slots=True)
class StateLeft(RunEvent):
    """A state or machine was left, and has halted.

    ``target`` is the path of the next state or machine, ``=OUTCOME`` of the parent machine, or '' for a child of a
    concurrency container that continues without it. A repeated node has no outcome and its own path as target.
    """

    path: str
    outcome: str
    target: str
    reason: ExitReason


@dataclass(slots=True)
class ContainerEnded(RunEvent):
    """All children of a concurrency container have halted; it wants to be left by an outcome."""

    path: str
    outcome: str


@dataclass(slots=True)
class Faulted(RunEvent):
    """A state or a command raised, or a state did not halt."""

    path: str
    text: str


@dataclass(slots=True)
class Logged(RunEvent):
    """A line for the operator."""

    severity: Severity
    path: str
    text: str


# The operator.


@dataclass(slots=True)
class DecisionAsked(RunEvent):
    """The run asks the operator for a decision."""

    decision: Decision


@dataclass(slots=True)
class DecisionClosed(RunEvent):
    """A decision is no longer pending, whatever the result."""

    decision: Decision


@dataclass(slots=True)
class DecisionTaken(RunEvent):
    """The operator has confirmed a decision."""

    decision_id: str


@dataclass(slots=True)
class OutcomeForced(RunEvent):
    """The operator has forced an outcome of a state or machine."""

    path: str
    outcome: str


@dataclass(frozen=True, slots=True)
class TransitionBlocked(RunEvent):
    """A state or machine wants an outcome but stays, since a transition would leave the nodes in ``locked``."""

    path: str
    outcome: str
    locked: tuple[str, ...]


@dataclass(slots=True)
class TransitionUnblocked(RunEvent):
    """A state or machine is no longer blocked by a lock, or it wants another outcome."""

    path: str


@dataclass(slots=True)
class AutonomySet(RunEvent):
    """The operator has set the level of autonomy of a sub-tree."""

    path: str
    level: int


@dataclass(slots=True)
class LockSet(RunEvent):
    """The operator has locked a state or machine, or unlocked it."""

    path: str
    is_set: bool


@dataclass(slots=True)
class BreakpointSet(RunEvent):
    """The operator has set a breakpoint at a state or machine, or cleared it."""

    path: str
    is_set: bool


@dataclass(slots=True)
class CommandDecided(RunEvent):
    """A command was applied (``refusal`` is None) or refused with a reason. Sent once for each command.

    ``command_id`` is the id from the caller of the command.
    """

    command_id: object
    refusal: str | None


_logger = logging.getLogger(__name__)

_LEVELS: Final = {
    Severity.DEBUG: logging.DEBUG,
    Severity.INFO: logging.INFO,
    Severity.HINT: logging.INFO,
    Severity.WARN: logging.WARNING,
    Severity.ERROR: logging.ERROR,
}


class LoggingReader(RunReader):
    """A reader that writes to Python's log: each transition as INFO, faults as ERROR."""

    reads = (StateLeft, Logged, Faulted)

    def read(self, event: RunEvent) -> None:
        match event:
            case StateLeft():
                _logger.info('%s > %s, %s', event.path, event.outcome or '(again)', event.reason.value)
            case Logged():
                _logger.log(_LEVELS[event.severity], '%s: %s', event.path, event.text)
            case Faulted():
                _logger.error('%s: %s', event.path, event.text)
