# SPDX-License-Identifier: BSD-3-Clause
"""The stream of typed events of a run, in order, and the interface of its readers."""

from __future__ import annotations

from contextlib import ExitStack
from dataclasses import dataclass
from typing import Any, Protocol

from flexbt_core.behavior_tree.engine.observers import Log
from flexbt_core.behavior_tree.engine.tree import Tree
from flexbt_server.groot2.log_file import TeeLog


@dataclass(frozen=True, slots=True)
class RunStarted:
    """The nodes exist; the first tick is next."""

    tree: Tree


@dataclass(frozen=True, slots=True)
class TreeExpanded:
    """Leaves have had trees made below them: nodes and their uids are new, from the next mark on."""

    tree: Tree


@dataclass(frozen=True, slots=True)
class RoundEnded:
    """A round of a tick is over. The log of each reader has a mark for each change of a status in it."""


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
    """The values of another client do not fit; the run goes on for the one that it has."""

    client: Any
    reason: str


@dataclass(frozen=True, slots=True)
class RunWarning:
    """A warning: ticks take longer than the tick period, or the tree keeps waking itself. Each at most once a
    second."""

    text: str


@dataclass(frozen=True, slots=True)
class PropertyViolated:
    """A monitor has found something. The outcome has it, too."""

    text: str


@dataclass(frozen=True)
class RunOutcome:
    """The outcome of a run; ``code`` is a constant of BtExecute.Result.

    ``message`` names ``failed_node``, where there is one, as ``PATH: reason`` or ``[PATH]``.
    ``error_code`` is the lowest that a leaf of the run has left, as in Nav2; 0 for none.
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
    """A reader of the events of one run, called on the thread of the run. An aborted run ends on another thread."""

    log: Log | None = None
    """Log in which the tree records changes of statuses for this reader; always the same one."""

    def read(self, event: RunEvent) -> None:
        """Handle an event."""
        raise NotImplementedError


class RunWatcher(Protocol):
    """A part of the server that reads the events of every run."""

    def open(self, events: RunEvents) -> RunReader:
        """Return the reader of a run that is about to start."""


class RunEvents:
    """The events of one run, given to its readers in the order in which these were added."""

    def __init__(self, run_id: str, blackboard: str) -> None:
        self.run_id = run_id
        self.blackboard = blackboard
        self._readers: list[RunReader] = []

    def add(self, reader: RunReader) -> None:
        """Give all events to this reader, too. Before the run starts."""
        self._readers.append(reader)

    @property
    def log(self) -> Log | None:
        """Log in which the tree records changes of statuses; None if no reader needs them."""
        logs = [reader.log for reader in self._readers if reader.log is not None]
        return TeeLog(logs) if len(logs) > 1 else next(iter(logs), None)

    def emit(self, event: RunEvent) -> None:
        """Give an event to every reader."""
        for reader in self._readers:
            reader.read(event)

    def end(self, outcome: RunOutcome) -> None:
        """Give every reader the last event, whatever another reader raises."""
        with ExitStack() as readers:
            for reader in reversed(self._readers):
                readers.callback(reader.read, RunEnded(outcome))
