# SPDX-License-Identifier: BSD-3-Clause
"""What a run tells, brought to where it belongs: the journal first, then event log and operators, then its supervisor.

All of it is called on the thread of the run.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any, Protocol

from flexbt_core.state_machine import Answer, Position
from flexbt_msgs.msg import BehaviorStructure
from flexbt_onboard.behaviors import RunRequest
from flexbt_onboard.durability import Decided, RunJournal
from flexbt_onboard.event_log import Reporter

from .run_snapshot import RunEnd


class RunOwner(Protocol):
    """Hears on any thread how its run goes."""

    def run_changed(self) -> None:
        """There is another snapshot."""

    def run_began(self, structure: BehaviorStructure) -> None:
        """The behavior is built."""

    def run_refused(self, reason: str) -> None:
        """The behavior could not be built."""

    def run_switched(self, structure: BehaviorStructure) -> None:
        """The run goes on with another behavior."""

    def run_stopping(self) -> None:
        """The run was told to stop."""

    def run_ended(self, end: RunEnd) -> None:
        """A run that was built has ended."""


class RunRecorder:
    """Observer of one run; see :class:`flexbt_onboard.runs.run_observer.BehaviorRunObserver`.

    ``answer`` is that of the command that has started it.
    """

    def __init__(
        self, run_id: str, behavior: str, answer: Answer, journal: RunJournal, report: Reporter, owner: RunOwner
    ) -> None:
        self._run_id = run_id
        self._behavior = behavior
        self._answer = answer
        self._journal = journal
        self._report = report
        self._owner = owner
        self._switched_to: tuple[RunRequest, BehaviorStructure] | None = None
        self.changed = owner.run_changed

    def built(self, request: RunRequest, structure: BehaviorStructure) -> None:
        """The behavior is built and begins to run."""
        self._journal.begin(self._run_id, request, self._answer)
        self._report.run_started(self._run_id, request)
        self._owner.run_began(structure)

    def refused(self, reason: str) -> None:
        """The behavior could not be built; the run has ended."""
        self._report.run_refused(self._run_id, self._behavior, reason)
        self._owner.run_refused(reason)

    def log(self, severity: int, path: str, text: str) -> None:
        """A state or the engine has something to say."""
        self._report.log(severity, text, path, self._run_id)

    def event(self, event: str, fields: Mapping[str, Any]) -> None:
        """Something for the event log."""
        self._report.event(event, run=self._run_id, **fields)

    def moved(self, position: Callable[[], Position], decided: Sequence[Decided]) -> None:
        """The machine is where it was not before, or commands were decided."""
        switched, self._switched_to = self._switched_to, None
        request, structure = switched or (None, None)
        for type_name in self._journal.move(self._run_id, position, decided, request):
            self._report.not_journaled(self._run_id, type_name)
        if structure is not None:
            self._owner.run_switched(structure)

    def switched(self, request: RunRequest, structure: BehaviorStructure) -> None:
        """The run goes on with another behavior; its owner is told when that is journaled."""
        self._switched_to, self._behavior = (request, structure), request.entry.name
        self._report.run_switched(self._run_id, request)

    def stopping(self, why: str) -> None:
        """The run is told to stop: it does not go on after a crash."""
        self._journal.end(self._run_id, why)
        self._report.event('stopping', run=self._run_id, why=why)
        self._owner.run_stopping()

    def ended(self, end: RunEnd) -> None:
        """The run has ended, and everything has halted."""
        self._journal.end(self._run_id, end.outcome)
        self._report.run_ended(self._run_id, self._behavior, end.outcome, end.message)
        self._owner.run_ended(end)
