# SPDX-License-Identifier: BSD-3-Clause
"""The status that the executive publishes: everything that an operator has to know, in one message."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Final

from flexbt_core.state_machine import ROOT_PATH
from flexbt_msgs.msg import ActiveState, AutonomyLevel, ExecutiveStatus
from flexbt_onboard.runs.behavior_run import RunPhase

if TYPE_CHECKING:
    from flexbt_onboard.node.executive import Executive

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
    interrupted = executive.interrupted
    if interrupted is not None:
        status.state = ExecutiveStatus.INTERRUPTED
        status.run_id, status.behavior = interrupted.run_id, interrupted.behavior
        status.message = 'the executive ended while this ran; resume it, or abort it'
        status.autonomy = interrupted.autonomy
        status.active_states = [ActiveState(path=path) for path in interrupted.active]
        status.locked, status.breakpoints = interrupted.locked, interrupted.breakpoints
        status.autonomy_levels = _levels(interrupted.levels)
    elif run is None:
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
        status.autonomy_levels = _levels(view.levels)
        decisions = [*run.decisions(), *status.decisions]
        status.decisions = sorted(decisions, key=lambda decision: (decision.since.sec, decision.since.nanosec))
    if executive.gate.refusal:
        status.message = '; '.join(filter(None, [status.message, executive.gate.refusal]))
    return status


def _levels(levels: Mapping[str, int]) -> list[AutonomyLevel]:
    return [AutonomyLevel(path=path, level=level) for path, level in sorted(levels.items()) if path != ROOT_PATH]
