# SPDX-License-Identifier: BSD-3-Clause
"""The stream of typed events of a run, in order, and the interface of its readers."""

from __future__ import annotations

from contextlib import ExitStack
from dataclasses import dataclass
from typing import Any, Protocol

from flexbt_core.behavior_tree.engine.observers import Log
from flexbt_core.behavior_tree.engine.tick_control import TickControl
from flexbt_core.behavior_tree.engine.tree import Tree
from flexbt_server.groot2.log_file import TeeLog


@dataclass(frozen=True, slots=True)
class RunStarted:
    """The nodes exist, and the first tick follows. ``control`` is for a debugger."""

    tree: Tree
    control: TickControl | None = None


@dataclass(frozen=True, slots=True)
class TreeExpanded:
    """New trees were created below leaves: the nodes and uids change from the next mark on."""

    tree: Tree


@dataclass(frozen=True, slots=True)
class RoundEnded:
    """A round of a tick has ended. The log of each reader has a mark for each status change in it. Readers without a
    log do not get it."""


@dataclass(frozen=True, slots=True)
class RunPaused:
    """The tree is no longer ticked, or is ticked again."""

    is_paused: bool


@dataclass(frozen=True, slots=True)
class RunAdopted:
    """The run works for another client from now on."""

    client: Any


@dataclass(frozen=True, slots=True)
class OfferRefused:
    """The values of another client do not fit; the run continues for its present client."""

    client: Any
    reason: str


@dataclass(frozen=True, slots=True)
class RunWarning:
    """A warning: ticks take longer than the tick period, or the tree keeps waking itself. Each at most once a
    second."""

    text: str


@dataclass(frozen=True, slots=True)
class PropertyViolated:
    """A monitor has found a violation, which is also in the outcome."""

    text: str


@dataclass(frozen=True)
class RunOutcome:
    """The outcome of a run; ``code`` is a constant of BtExecute.Result.

    ``message`` names ``failed_node``, if any, as ``PATH: reason`` or ``[PATH]``.
    ``error_code`` is the lowest error code that a leaf of the run has written, as in Nav2; 0 for none.
    """

    code: int
    message: str = ''
    failed_node: str = ''
    reasons: tuple[str, ...] = ()
    error_code: int = 0


@dataclass(frozen=True, slots=True)
class RunEnded:
    """The last event."""

    outcome: RunOutcome


RunEvent = (
    RunStarted
    | TreeExpanded
    | RoundEnded
    | RunPaused
    | RunAdopted
    | OfferRefused
    | RunWarning
    | PropertyViolated
    | RunEnded
)


class RunReader:
    """A reader of the events of one run, called on the run's thread; for the end of an aborted run, on another one."""

    log: Log | None = None
    """Log in which the tree records status changes for this reader; always the same object."""

    def read(self, event: RunEvent) -> None:
        """Handle an event."""
        raise NotImplementedError


class RunWatcher(Protocol):
    """A part of the server that reads the events of every run."""

    def open(self, events: RunEvents) -> RunReader:
        """Return the reader for a run that is about to start."""


class RunEvents:
    """The events of one run. Its readers get them in the order in which they were added."""

    def __init__(self, run_id: str, blackboard: str) -> None:
        self.run_id = run_id
        self.blackboard = blackboard
        self._readers: list[RunReader] = []
        self._readers_of_rounds: list[RunReader] = []

    def add(self, reader: RunReader) -> None:
        """Add a reader. Call this before the run starts."""
        self._readers.append(reader)
        if reader.log is not None:
            self._readers_of_rounds.append(reader)

    @property
    def log(self) -> Log | None:
        """Log in which the tree records status changes; None if no reader needs them."""
        logs = [reader.log for reader in self._readers if reader.log is not None]
        return TeeLog(logs) if len(logs) > 1 else next(iter(logs), None)

    def emit(self, event: RunEvent) -> None:
        """Send an event to every reader."""
        for reader in self._readers_of_rounds if event.__class__ is RoundEnded else self._readers:
            reader.read(event)

    def end(self, outcome: RunOutcome) -> None:
        """Send the last event to every reader, even if another reader raises."""
        with ExitStack() as readers:
            for reader in reversed(self._readers):
                readers.callback(reader.read, RunEnded(outcome))
