# SPDX-License-Identifier: BSD-3-Clause
"""The status of the executive: the contents of the message, and the time when consoles may see them."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

from geometry_msgs.msg import PoseStamped

from flexbt_common.calls.goal_server import GoalAdmission
from flexbt_common.runtime.clock_watch import ClockHealth
from flexbt_common.runtime.node_runtime import Runtime
from flexbt_common.values.decision_subject import subject_fields
from flexbt_common.values.message_fields import time_of_nanoseconds
from flexbt_core.state_machine.model.definition import ROOT_PATH
from flexbt_core.state_machine.model.state_host import Progress
from flexbt_msgs.msg import (
    ActiveState,
    AutonomyLevel,
    CommandResult,
    DecisionSubject,
    DecisionSubjects,
    ExecutiveStatus,
    MissionQueue,
    PeerStatus,
    PendingDecision,
)
from flexbt_msgs.msg import Progress as ProgressMessage
from flexbt_onboard.commands.authority import Authority
from flexbt_onboard.commands.command_ledger import CommandLedger
from flexbt_onboard.commands.input_requests import InputRequests
from flexbt_onboard.link.console_link import ConsoleLink
from flexbt_onboard.link.peers import PeersWatch
from flexbt_onboard.link.reporter import StorageProblems
from flexbt_onboard.link.robot_state import RobotPlan, RobotPose
from flexbt_onboard.link.status_publisher import StatusPublisher
from flexbt_onboard.link.tree_debugging import TreeDebuggingLink
from flexbt_onboard.mission_queue.queue_runner import QueueRunner
from flexbt_onboard.persistence.run_journal import InterruptedRun, RunJournal
from flexbt_onboard.runs.run_snapshot import ActiveLeaf, RunDecision, RunSnapshot
from flexbt_onboard.runs.run_supervisor import LastRun, RunSupervisor, ShownRun


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
    """Return the status of a run. The sender adds its id, number and time.

    ``gone`` are the nodes that have died. Each decision of the run lists them, since its outcome may depend on them.
    ``notice`` is added to the message: why no behavior can start, or which file cannot be written; '' for none.
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
            status.state = getattr(ExecutiveStatus, run.phase.name)
            status.message = '; '.join(filter(None, [run.not_stopped, run.wrong]))
            status.step = run.step
            status.active_states = [_active_state(leaf) for leaf in run.active]
            decisions = [*(_decision(decision, gone) for decision in run.decisions), *input_requests]
            status.decisions = sorted(decisions, key=lambda decision: (decision.since.sec, decision.since.nanosec))
    if not isinstance(run, LastRun):
        status.locked, status.breakpoints = list(run.locked), list(run.breakpoints)
        status.autonomy_levels = _levels(run.levels)
    status.message = '; '.join(filter(None, [status.message, notice]))
    return status


def subjects_of(run: ShownRun, of_requests: Sequence[DecisionSubject]) -> DecisionSubjects:
    """Return the subjects of the decisions of a run and of the input requests. The sender adds its id."""
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
        goal=known.goal if isinstance(known.goal, PoseStamped) else PoseStamped(),
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


# Consoles see the status and other messages about a run only once a crash cannot undo them.


class StatusPicture(NamedTuple):
    """A status, the subjects of its decisions, and the mission queue."""

    status: ExecutiveStatus
    subjects: DecisionSubjects
    queue: MissionQueue


@dataclass(frozen=True)
class StatusSources:
    """The sources from which a status is made."""

    journal: RunJournal
    admission: GoalAdmission
    problems: StorageProblems
    clock: ClockHealth
    peers: PeersWatch
    pose: RobotPose
    runs: RunSupervisor
    authority: Authority
    input_requests: InputRequests
    ledger: CommandLedger
    trees: TreeDebuggingLink
    queue: QueueRunner

    def picture(self) -> StatusPicture:
        """Return the current status, with what belongs to it."""
        run, gone = self.runs.shown, self.peers.gone()
        status = status_of(
            run,
            self.input_requests.decisions(),
            self.ledger.results(),
            self.peers.statuses(),
            self.pose.latest(),
            self.pose.problem(gone),
            self.authority,
            gone,
            '; '.join(filter(None, [self.admission.refusal, self.problems.text, self.clock.problem])),
        )
        status.tree_breakpoints, status.tree_holds = self.trees.breakpoints, self.trees.holds
        queue = self.queue.message
        status.queue_length, status.queue_held, status.queue_entry = len(queue.entries), queue.held, self.queue.running
        return StatusPicture(status, subjects_of(run, self.input_requests.subjects()), queue)


class ShownStatus(StatusPublisher):
    """A publisher that sends each status only after the journal has everything in it. Used on the executor thread.

    While the disk is slow, it repeats the previous status, so that the heartbeat continues.
    """

    def __init__(self, runtime: Runtime, link: ConsoleLink, plan: RobotPlan, period: float) -> None:
        """Do not send anything before :meth:`begin`."""
        super().__init__(runtime, period)
        self._link = link
        self._plan = plan
        self._to_show: deque[Callable[[], None]] = deque()
        self._is_waiting = False
        self._is_outdated = False

    def begin(self, sources: StatusSources) -> None:
        """Set the sources of the status. Call before any event, while everything in the status is durable."""
        self._sources = sources
        self._picture = sources.picture()

    @property
    def message(self) -> ExecutiveStatus:
        """The status that was sent last, or is going to be sent first."""
        return self._picture.status

    def show(self, publish: Callable[[], None]) -> None:
        """Call ``publish`` once the journal has all events so far. The order of calls is kept."""
        self._to_show.append(publish)
        self._sources.journal.when_durable(lambda: self._on_executor(self._show_next))

    def send(self) -> None:
        """Send the current status as soon as it is durable, and until then repeat the previous one."""
        if self._is_waiting:
            self._is_outdated = True
            self._publish(self._picture)
        else:
            picture = self._sources.picture()
            self._is_waiting = True
            self.show(lambda: self._show(picture))
        self._sources.runs.status_sent()

    def _show_next(self) -> None:
        # Take the oldest, no matter which one the journal reports: everything before that is durable too.
        self._to_show.popleft()()

    def _on_executor(self, fn: Callable[[], None]) -> None:
        if self._runtime.on_executor_thread:
            fn()
        else:
            self._runtime.post(fn)

    def _show(self, picture: StatusPicture) -> None:
        self._is_waiting, self._picture = False, picture
        self._publish(picture)
        if self._is_outdated:
            self._is_outdated = False
            self.changed()

    def _publish(self, picture: StatusPicture) -> None:
        if self._link.publish_subjects(picture.subjects):
            self._plan.judged(picture.subjects.subjects)
        self._link.publish_queue(picture.queue)
        self._link.publish_status(picture.status)
