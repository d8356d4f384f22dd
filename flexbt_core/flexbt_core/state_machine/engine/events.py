# SPDX-License-Identifier: BSD-3-Clause
"""The events of a run, and the readers of them.

A run is a stream of events. The engine makes each in one place and gives it to the readers at once, in their order.
They come on the thread of the run, except :class:`Logged`, which a state may cause on any thread, and
:class:`CommandDecided` of a command that comes after the end.
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
    """Types of the events that it reads; () for all of them. The engine makes none without a reader."""

    def read(self, event: RunEvent) -> None:
        """Take an event in."""

    def methods(self) -> Mapping[type[RunEvent], Callable[[Any], None]]:
        """Return what takes the events of each type in. A reader with a method for each type has them called here."""
        return dict.fromkeys(self.reads or RunEvent.__subclasses__(), self.read)

    def next_wake(self) -> float | None:
        """Return when the run must be stepped again at the latest for this reader, on the clock of the run."""
        return None


# The run as a whole.


@dataclass(slots=True)
class RunStarted(RunEvent):
    """The run begins; nothing was entered yet.

    One that goes on where another was ``is_resumed``: then these states are ``active`` already and are not entered
    again, and ``approved`` are the outcomes, by path, that the operator has allowed.
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
    """The run goes on with another machine; the active states stay as they are."""

    definition: MachineDefinition


class RunRested(RunEvent):
    """Nothing more can happen until something wakes the run."""

    __slots__ = ()


class RunEnding(RunEvent):
    """The run is being left for good: nothing may be entered any more."""

    __slots__ = ()


@dataclass(slots=True)
class HaltAwaited(RunEvent):
    """The end of the run waits for ``text`` to halt; '' when everything has."""

    text: str


@dataclass(slots=True)
class RunEnded(RunEvent):
    """The run has ended, and everything has halted or is no longer waited for."""

    outcome: str
    message: str


# States and machines, by their paths.


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
    """A state stands still from now on, or goes on."""

    path: str
    is_paused: bool


@dataclass(slots=True)
class OutcomeTaken(RunEvent):
    """A state or machine is left next by an outcome that it wants, which requires a level of autonomy."""

    path: str
    outcome: str
    required: int


@dataclass(slots=True)
class StateLeft(RunEvent):
    """A state or machine was left, and has halted.

    ``target`` is the path of what follows, ``=OUTCOME`` of the machine around it, or '' for a child of a concurrency
    container that goes on without it. One that is repeated has no outcome, and follows itself.
    """

    path: str
    outcome: str
    target: str
    reason: ExitReason


@dataclass(slots=True)
class ContainerEnded(RunEvent):
    """Everything in a concurrency container has halted; it wants an outcome."""

    path: str
    outcome: str


@dataclass(slots=True)
class Faulted(RunEvent):
    """A state raised or did not halt, or a command raised."""

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
    """The operator is asked."""

    decision: Decision


@dataclass(slots=True)
class DecisionClosed(RunEvent):
    """A decision is no longer pending, with any result."""

    decision: Decision


@dataclass(slots=True)
class DecisionTaken(RunEvent):
    """The operator has confirmed what a decision asks for."""

    decision_id: str


@dataclass(slots=True)
class OutcomeForced(RunEvent):
    """The operator wants a state or machine to be left by an outcome."""

    path: str
    outcome: str


@dataclass(frozen=True, slots=True)
class TransitionBlocked(RunEvent):
    """A state or machine is not left by an outcome that it wants, since that would leave what is ``locked``."""

    path: str
    outcome: str
    locked: tuple[str, ...]


@dataclass(slots=True)
class TransitionUnblocked(RunEvent):
    """No lock prevents the state or machine from being left any more, or it wants something else."""

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
    """A command had its effect (``refusal`` is None), or was refused with a reason. Once for each command.

    ``command_id`` is the id that was given with it.
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
