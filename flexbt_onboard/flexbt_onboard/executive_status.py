# SPDX-License-Identifier: BSD-3-Clause
"""The status that the executive publishes: everything that an operator has to know, in one message."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from flexbt_msgs.msg import AutonomyLevel, ExecutiveStatus
from flexbt_onboard.behavior_run import RunPhase
from flexbt_onboard.state_machine import ROOT_PATH

if TYPE_CHECKING:
    from flexbt_onboard.executive import Executive

_STATE_OF_PHASE: Final = {
    RunPhase.STARTING: ExecutiveStatus.STARTING,
    RunPhase.RUNNING: ExecutiveStatus.RUNNING,
    RunPhase.PAUSED: ExecutiveStatus.PAUSED,
    RunPhase.STOPPING: ExecutiveStatus.STOPPING,
}


def status_of(executive: Executive) -> ExecutiveStatus:
    """The present status; sender, number and time are for whoever sends it. On the executor thread."""
    status = ExecutiveStatus(
        autonomy=executive.level,
        decisions=executive.questions.decisions(),
        results=executive.command_table.latest(),
        peers=executive.peers.statuses(),
        robot_pose=executive.pose.latest(),
        authority=executive.authority.holder,
        authority_requests=executive.authority.requests,
    )
    run = executive.run
    if run is None:
        last = executive.last
        status.state = ExecutiveStatus.IDLE
        status.run_id, status.behavior = last.run_id, last.behavior
        status.outcome, status.message = last.outcome, last.message
    else:
        status.state = _STATE_OF_PHASE[run.phase]
        status.run_id, status.behavior = run.run_id, run.behavior
        view = run.view
        status.active_states = run.active_states()
        status.locked, status.breakpoints = list(view.locked), list(view.breakpoints)
        status.autonomy_levels = [
            AutonomyLevel(path=path, level=level) for path, level in sorted(view.levels.items()) if path != ROOT_PATH
        ]
        decisions = [*run.decisions(), *status.decisions]
        status.decisions = sorted(decisions, key=lambda decision: (decision.since.sec, decision.since.nanosec))
    return status
