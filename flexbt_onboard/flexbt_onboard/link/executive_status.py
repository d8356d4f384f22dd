# SPDX-License-Identifier: BSD-3-Clause
"""The status that the executive publishes: everything that an operator has to know, in one message."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Final

from geometry_msgs.msg import PoseStamped

from flexbt_common.values import subject_fields, time_of_nanoseconds
from flexbt_core.state_machine import ROOT_PATH, Progress
from flexbt_msgs.msg import (
    ActiveState,
    AutonomyLevel,
    CommandResult,
    DecisionSubject,
    DecisionSubjects,
    ExecutiveStatus,
    PeerStatus,
    PendingDecision,
)
from flexbt_msgs.msg import Progress as ProgressMessage
from flexbt_onboard.commands import Authority
from flexbt_onboard.durability import InterruptedRun
from flexbt_onboard.runs import ActiveLeaf, LastRun, RunDecision, RunPhase, RunSnapshot, ShownRun

_STATE_OF_PHASE: Final = {
    RunPhase.STARTING: ExecutiveStatus.STARTING,
    RunPhase.RUNNING: ExecutiveStatus.RUNNING,
    RunPhase.PAUSED: ExecutiveStatus.PAUSED,
    RunPhase.STOPPING: ExecutiveStatus.STOPPING,
}


def status_of(
    run: ShownRun,
    input_requests: Sequence[PendingDecision],
    results: Sequence[CommandResult],
    peers: Sequence[PeerStatus],
    pose: PoseStamped,
    pose_problem: str,
    authority: Authority,
    gone: Sequence[str],
    notice: str,
) -> ExecutiveStatus:
    """A status of the run that is shown; sender, number and time are for whoever sends it.

    ``gone`` are the nodes that have died, which is said with each decision of the run: what it is about may need them.
    ``notice`` is what else has to be said: why nothing can be started, what cannot be written to the disk; or ''.
    """
    status = ExecutiveStatus(
        run_id=run.run_id,
        behavior=run.behavior,
        autonomy=run.autonomy,
        decisions=list(input_requests),
        results=list(results),
        peers=list(peers),
        robot_pose=pose,
        pose_problem=pose_problem,
        authority=authority.holder,
        authority_requests=list(authority.requests),
    )
    match run:
        case LastRun():
            status.state = ExecutiveStatus.IDLE
            status.outcome, status.message = run.outcome, run.message
        case InterruptedRun():
            status.state = ExecutiveStatus.INTERRUPTED
            how = 'was paused; resume it, which leaves it paused' if run.is_paused else 'ran; resume it'
            status.message = f'the executive ended while this {how}, or abort it'
            status.active_states = [ActiveState(path=path, paused=run.is_paused) for path in run.active]
        case RunSnapshot():
            status.state = _STATE_OF_PHASE[run.phase]
            status.message = '; '.join(filter(None, [run.not_stopped, run.wrong]))
            status.active_states = [_active_state(leaf) for leaf in run.active]
            decisions = [*(_decision(decision, gone) for decision in run.decisions), *input_requests]
            status.decisions = sorted(decisions, key=lambda decision: (decision.since.sec, decision.since.nanosec))
    if not isinstance(run, LastRun):
        status.locked, status.breakpoints = list(run.locked), list(run.breakpoints)
        status.autonomy_levels = _levels(run.levels)
    status.message = '; '.join(filter(None, [status.message, notice]))
    return status


def subjects_of(run: ShownRun, of_requests: Sequence[DecisionSubject]) -> DecisionSubjects:
    """Return what the decisions of that status are about; the sender is for whoever sends it."""
    decisions = run.decisions if isinstance(run, RunSnapshot) else ()
    of_decisions = [decision.subject for decision in decisions if decision.subject is not None]
    return DecisionSubjects(subjects=[*of_decisions, *of_requests])


def _active_state(leaf: ActiveLeaf) -> ActiveState:
    return ActiveState(
        path=leaf.path,
        entered=time_of_nanoseconds(leaf.entered),
        paused=leaf.is_paused,
        not_paused=list(leaf.not_paused),
        activity=[*leaf.held_back, *leaf.activity],
        tree_run_id=leaf.progress.tree_run_id if leaf.progress is not None else '',
        progress=[_progress(leaf.progress)] if leaf.progress is not None and leaf.progress.is_known else [],
    )


def _progress(known: Progress) -> ProgressMessage:
    return ProgressMessage(
        distance_remaining=known.distance,
        time_remaining=known.time,
        poses_remaining=known.poses,
        recoveries=known.recoveries,
        goal=known.goal or PoseStamped(),
    )


def _decision(decision: RunDecision, gone: Sequence[str]) -> PendingDecision:
    missing = [f'{name} is gone: restart it, or force an outcome' for name in gone]
    return PendingDecision(
        id=decision.id,
        kind=decision.kind.value,
        path=decision.path,
        outcome=decision.outcome,
        outcomes=list(decision.outcomes),
        required_autonomy=decision.required_autonomy,
        prompt='; '.join(filter(None, [decision.prompt, *missing])),
        since=time_of_nanoseconds(decision.since),
        **subject_fields(decision.subject),
    )


def _levels(levels: Mapping[str, int]) -> list[AutonomyLevel]:
    return [AutonomyLevel(path=path, level=level) for path, level in sorted(levels.items()) if path != ROOT_PATH]
