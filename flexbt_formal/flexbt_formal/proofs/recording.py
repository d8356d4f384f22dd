# SPDX-License-Identifier: BSD-3-Clause
"""Ways to what is wrong, as a recording of an executive that took them: ``console replay`` shows it.

Each step takes a second. A tree by itself is shown as run by a state of a machine that has no other. Several ways
follow each other, as runs of the same executive.
"""

from __future__ import annotations

import time
from collections.abc import Iterable
from pathlib import Path
from typing import Any, Final

from builtin_interfaces.msg import Time as TimeMessage
from rclpy.time import Time

from flexbt_common import names
from flexbt_console.recording.run_file import write_recording
from flexbt_core.state_machine.model.autonomy import Autonomy, Decision
from flexbt_formal.exploration.explorer import walk
from flexbt_formal.exploration.machine_system import MachineSystem
from flexbt_formal.exploration.model import Counterexample, Report, System
from flexbt_formal.exploration.tree_system import TreeSystem
from flexbt_msgs.msg import (
    ActiveState,
    BehaviorStructure,
    ExecutiveLog,
    ExecutiveStatus,
    PendingDecision,
    StateStructure,
    TreeStatus,
)
from flexbt_onboard.behaviors.run_building import structure_message
from flexbt_server.runs.tree_stream import tree_structure

STEP_SECONDS: Final = 1.0
_HEARTBEAT: Final = 60.0
_EXECUTIVE: Final = 'proof'
_TREE: Final = '/tree'


def record(file: Path, found: Iterable[tuple[Report, Counterexample]]) -> None:
    """Write what was found into a new MCAP file. Raises OSError."""
    recording = _Recording(time.time_ns())
    for report, counterexample in found:
        recording.add(report, counterexample)
    write_recording(file, recording.messages)


class _Recording:
    def __init__(self, begin: int) -> None:
        self.messages: list[tuple[int, str, Any]] = []
        self._now = begin
        self._runs = 0
        self._statuses = 0
        self._lines = 0

    def add(self, report: Report, found: Counterexample) -> None:
        """One way; at its end what is wrong."""
        assert report.make is not None
        self._runs += 1
        shown = _Shown(report.name, f'counterexample-{self._runs}')
        system = report.make()
        self._send(names.EXECUTIVE_STRUCTURE, shown.structure(system))
        if isinstance(system, TreeSystem):
            self._send(
                names.TREE_STRUCTURE, tree_structure(system.tree, shown.run_id, 1, '', Time(nanoseconds=self._now))
            )
        self._say(shown, f'the way to: {found.violation.text}', ExecutiveLog.HINT)
        self._picture(shown, system, 0)
        for number, moment in enumerate(walk(report.make, found.moves), start=1):
            self._now += int(STEP_SECONDS * 1e9)
            self._say(shown, f'{number}. {moment}')
            for line in moment.happened:
                self._say(shown, f'   {line}')
            self._picture(shown, moment.system, number)
        self._say(shown, f'WRONG: {found.violation.text}', ExecutiveLog.ERROR)
        self._now += int(STEP_SECONDS * 1e9)

    def _picture(self, shown: _Shown, system: System, number: int) -> None:
        """Snapshot after a step."""
        status = shown.status(system, self._stamp)
        self._statuses += 1
        status.executive_id, status.sequence, status.stamp = _EXECUTIVE, self._statuses, self._stamp
        status.heartbeat_period = _HEARTBEAT
        self._send(names.EXECUTIVE_STATUS, status)
        if isinstance(system, TreeSystem):
            self._send(names.TREE_STATUS, shown.tree_status(system, number + 1, self._stamp))

    def _say(self, shown: _Shown, text: str, severity: int = ExecutiveLog.INFO) -> None:
        self._lines += 1
        line = ExecutiveLog(
            stamp=self._stamp,
            sequence=self._lines,
            executive_id=_EXECUTIVE,
            run_id=shown.run_id,
            severity=severity,
            text=text,
        )
        self._send(names.EXECUTIVE_LOG, line)

    @property
    def _stamp(self) -> TimeMessage:
        return Time(nanoseconds=self._now).to_msg()

    def _send(self, name: str, message: Any) -> None:
        self.messages.append((self._now, name, message))


class _Shown:
    """View of a system as the run of an executive."""

    def __init__(self, name: str, run_id: str) -> None:
        self.run_id = run_id
        self._name = name
        self._entered: dict[str, TimeMessage] = {}

    def structure(self, system: System) -> BehaviorStructure:
        """Its states; of a tree the one that runs it."""
        if isinstance(system, MachineSystem):
            return structure_message(system.run.definition, self.run_id, self._name)
        states = [
            StateStructure(path='/', kind=StateStructure.MACHINE, children=[_TREE[1:]], outcomes=['ended']),
            StateStructure(
                path=_TREE, kind=StateStructure.STATE, type='tree', outcomes=['ended'], targets=['=ended'], autonomy=[0]
            ),
        ]
        return BehaviorStructure(run_id=self.run_id, behavior=self._name, states=states)

    def status(self, system: System, now: TimeMessage) -> ExecutiveStatus:
        """Return what is active, and what the operator is asked."""
        status = ExecutiveStatus(run_id=self.run_id, behavior=self._name, state=ExecutiveStatus.RUNNING)
        if system.ended is not None:
            status.state, status.outcome = ExecutiveStatus.IDLE, system.ended
        elif isinstance(system, MachineSystem):
            run = system.run
            status.autonomy = run.autonomy_of('/')
            if run.is_paused or run.is_ending:
                status.state = ExecutiveStatus.STOPPING if run.is_ending else ExecutiveStatus.PAUSED
            status.active_states = [ActiveState(path=leaf.path) for leaf in run.active_states()]
            status.decisions = [_decision(one) for one in run.decisions]
        elif isinstance(system, TreeSystem):
            status.autonomy = Autonomy.Full
            active = system.tree.active_nodes(leaves_only=True)
            status.active_states = [ActiveState(path=_TREE, tree_run_id=self.run_id, activity=list(active))]
        paths = [state.path for state in status.active_states]
        self._entered = {path: self._entered.get(path, now) for path in paths}
        for state in status.active_states:
            state.entered = self._entered[state.path]
        return status

    def tree_status(self, system: TreeSystem, sequence: int, stamp: TimeMessage) -> TreeStatus:
        """Return the status of each node."""
        return TreeStatus(
            stamp=stamp,
            run_id=self.run_id,
            structure=1,
            sequence=sequence,
            finished=system.ended is not None,
            statuses=[node.status.value for node in system.tree.nodes],
        )


def _decision(decision: Decision) -> PendingDecision:
    return PendingDecision(
        id=decision.id,
        kind=decision.kind.value,
        path=decision.path,
        outcome=decision.outcome,
        outcomes=list(decision.outcomes),
        required_autonomy=decision.required,
        prompt=decision.prompt,
    )
