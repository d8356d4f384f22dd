# SPDX-License-Identifier: BSD-3-Clause
"""Paths to violations as a recording of an executive, which ``console replay`` shows.

Each step takes a second. A tree without a machine is shown as run by the only state of a machine. Several paths
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
from flexbt_core.state_machine.model.autonomy import Autonomy
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
    """Write counterexamples into a new MCAP file. Raises OSError."""
    recording = _Recording(time.time_ns())
    for report, counterexample in found:
        recording.add(report, counterexample)
    write_recording(file, recording.messages)


class _Recording:
    def __init__(self, begin: int) -> None:
        self.messages: list[tuple[int, str, Any]] = []
        self._now = begin
        self._runs = self._statuses = self._lines = 0
        self._behavior = self._run_id = ''
        self._entered: dict[str, TimeMessage] = {}

    def add(self, report: Report, found: Counterexample) -> None:
        """Add the path of a counterexample, followed by its violation."""
        assert report.make is not None
        self._runs += 1
        self._behavior, self._run_id = report.name, f'counterexample-{self._runs}'
        self._entered = {}
        system = report.make()
        self._send(names.EXECUTIVE_STRUCTURE, self._structure(system))
        if isinstance(system, TreeSystem):
            now = Time(nanoseconds=self._now)
            self._send(names.TREE_STRUCTURE, tree_structure(system.tree, self._run_id, 1, '', now))
        self._say(f'the way to: {found.violation.text}', ExecutiveLog.HINT)
        self._show(system, 0)
        for number, moment in enumerate(walk(report.make, found.moves), start=1):
            self._now += int(STEP_SECONDS * 1e9)
            self._say(f'{number}. {moment}')
            for line in moment.happened:
                self._say(f'   {line}')
            self._show(moment.system, number)
        self._say(f'WRONG: {found.violation.text}', ExecutiveLog.ERROR)
        self._now += int(STEP_SECONDS * 1e9)

    def _structure(self, system: System) -> BehaviorStructure:
        """Return the states of a machine; for a tree, the state that runs it."""
        if isinstance(system, MachineSystem):
            return structure_message(system.run.definition, self._run_id, self._behavior)
        states = [
            StateStructure(path='/', kind=StateStructure.MACHINE, children=[_TREE[1:]], outcomes=['ended']),
            StateStructure(
                path=_TREE, kind=StateStructure.STATE, type='tree', outcomes=['ended'], targets=['=ended'], autonomy=[0]
            ),
        ]
        return BehaviorStructure(run_id=self._run_id, behavior=self._behavior, states=states)

    def _show(self, system: System, number: int) -> None:
        """Write the active states and pending decisions after a step; for a tree, the status of each node."""
        self._statuses += 1
        status = ExecutiveStatus(
            executive_id=_EXECUTIVE,
            sequence=self._statuses,
            stamp=self._stamp,
            heartbeat_period=_HEARTBEAT,
            run_id=self._run_id,
            behavior=self._behavior,
            state=ExecutiveStatus.RUNNING,
        )
        if system.ended is not None:
            status.state, status.outcome = ExecutiveStatus.IDLE, system.ended
        elif isinstance(system, MachineSystem):
            run = system.run
            status.autonomy = run.controls.level('/')
            if run.is_paused or run.is_ending:
                status.state = ExecutiveStatus.STOPPING if run.is_ending else ExecutiveStatus.PAUSED
            status.active_states = [ActiveState(path=leaf.path) for leaf in run.active_states()]
            status.decisions = [
                PendingDecision(
                    id=one.id,
                    kind=one.kind.value,
                    path=one.path,
                    outcome=one.outcome,
                    outcomes=list(one.outcomes),
                    required_autonomy=one.required,
                    prompt=one.prompt,
                )
                for one in run.decisions
            ]
        elif isinstance(system, TreeSystem):
            status.autonomy = Autonomy.Full
            active = system.tree.active_nodes(leaves_only=True)
            status.active_states = [ActiveState(path=_TREE, tree_run_id=self._run_id, activity=list(active))]
        self._entered = {one.path: self._entered.get(one.path, self._stamp) for one in status.active_states}
        for state in status.active_states:
            state.entered = self._entered[state.path]
        self._send(names.EXECUTIVE_STATUS, status)
        if isinstance(system, TreeSystem):
            tree = TreeStatus(
                stamp=self._stamp,
                run_id=self._run_id,
                structure=1,
                sequence=number + 1,
                finished=system.ended is not None,
                statuses=[node.status.value for node in system.tree.nodes],
            )
            self._send(names.TREE_STATUS, tree)

    def _say(self, text: str, severity: int = ExecutiveLog.INFO) -> None:
        self._lines += 1
        line = ExecutiveLog(
            stamp=self._stamp,
            sequence=self._lines,
            executive_id=_EXECUTIVE,
            run_id=self._run_id,
            severity=severity,
            text=text,
        )
        self._send(names.EXECUTIVE_LOG, line)

    @property
    def _stamp(self) -> TimeMessage:
        return Time(nanoseconds=self._now).to_msg()

    def _send(self, name: str, message: Any) -> None:
        self.messages.append((self._now, name, message))
