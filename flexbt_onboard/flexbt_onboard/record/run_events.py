# SPDX-License-Identifier: BSD-3-Clause
"""What a run tells, brought to where it belongs: the journal first, then the record, the log and the status.

All of it is called on the thread of the run. What concerns the executive is posted to the executor thread.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

from flexbt_core.state_machine import MachineRun
from flexbt_msgs.msg import BehaviorStructure, ExecutiveLog
from flexbt_onboard.commands.command_answers import Decided
from flexbt_onboard.runs.behavior_run import BehaviorRun

if TYPE_CHECKING:
    from flexbt_onboard.node.executive import Executive


class RunNews:
    """Observer of the run that ``executive`` has begun; see :class:`flexbt_onboard.runs.behavior_run.RunObserver`."""

    def __init__(self, executive: Executive) -> None:
        self._executive = executive
        self._is_switched = False

    def changed(self) -> None:
        """Something that the operator is shown has changed."""
        self._executive.changed()

    def run_built(self, run: BehaviorRun, structure: BehaviorStructure) -> None:
        """The behavior is built and begins to run."""
        executive = self._executive
        request = run.request
        executive.journal.begin(run.run_id, request, executive.start_answer)
        executive.record.note(
            'started' if request.at is None else 'resumed',
            run=run.run_id,
            behavior=run.behavior,
            arguments=dict(request.arguments),
            inputs=[entry.key for entry in request.inputs],
            autonomy=request.autonomy,
            by=request.by,
        )
        executive.runtime.post(lambda: executive.run_begins(run, structure))

    def run_refused(self, run: BehaviorRun, reason: str) -> None:
        """The behavior could not be built; the run has ended."""
        self._executive.record.note('refused', run=run.run_id, behavior=run.behavior, why=reason)
        self._executive.runtime.post(lambda: self._executive.run_cannot_begin(run, reason))

    def run_log(self, run: BehaviorRun, severity: int, path: str, text: str) -> None:
        """A state or the engine has something to say."""
        self._executive.link.log(severity, text, path, run.run_id)

    def run_event(self, run: BehaviorRun, event: str, fields: Mapping[str, Any]) -> None:
        """Something for the record. A run that is told to stop does not go on after a crash."""
        if event == 'stopping':
            self._executive.journal.end(run.run_id, str(fields['why']))
        self._executive.record.note(event, run=run.run_id, **fields)

    def run_moved(self, run: BehaviorRun, machine: MachineRun, decided: Sequence[Decided]) -> None:
        """The machine is where it was not before, or commands were decided."""
        request = run.request if self._is_switched else None
        self._is_switched = False
        lost = self._executive.journal.move(run.run_id, machine, decided, request)
        for what in lost:
            self._executive.link.log(
                ExecutiveLog.WARN,
                f'the userdata has a {what}, which cannot be journaled: the run could not go on after a crash',
                run_id=run.run_id,
            )

    def run_switched(self, run: BehaviorRun, structure: BehaviorStructure) -> None:
        """The run goes on with another behavior."""
        executive = self._executive
        self._is_switched = True
        executive.record.note(
            'switched',
            run=run.run_id,
            behavior=run.behavior,
            arguments=dict(run.request.arguments),
            by=run.request.by,
        )
        executive.runtime.post(lambda: executive.link.publish_structure(structure))

    def run_ended(self, run: BehaviorRun, outcome: str, message: str) -> None:
        """The run has ended and everything is at rest, or as far at rest as ``message`` says."""
        self._executive.journal.end(run.run_id, outcome)
        self._executive.record.note('ended', run=run.run_id, behavior=run.behavior, outcome=outcome, message=message)
        self._executive.runtime.post(lambda: self._executive.run_is_over(run, outcome, message))
