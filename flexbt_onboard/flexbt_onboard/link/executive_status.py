# SPDX-License-Identifier: BSD-3-Clause
"""The status of the executive: the contents of the message, the part that may be shown yet, and the time of
publication."""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from typing import Final, NamedTuple

from geometry_msgs.msg import PoseStamped
from rclpy.clock import Clock, ClockType

from flexbt_common.runtime.node_runtime import Runtime
from flexbt_common.values.decision_subject import subject_fields
from flexbt_common.values.message_fields import time_of_nanoseconds
from flexbt_core.clock.clock import Timer
from flexbt_core.state_machine.model.definition import ROOT_PATH
from flexbt_core.state_machine.model.state_host import Progress
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
from flexbt_onboard.commands.authority import Authority
from flexbt_onboard.persistence.run_journal import InterruptedRun
from flexbt_onboard.runs.run_snapshot import ActiveLeaf, RunDecision, RunPhase, RunSnapshot
from flexbt_onboard.runs.run_supervisor import LastRun, ShownRun

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
    """Return a status of the run that is shown; sender, number and time are for whoever sends it.

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


# The status, and what else others are shown of a run: only what a crash cannot undo.


class StatusPicture(NamedTuple):
    """The status, and what its decisions are about."""

    status: ExecutiveStatus
    subjects: DecisionSubjects


class ShownStatus:
    """A status that is shown once the journal has everything in it. Used on the executor thread.

    While the disk is slow, the previous status is shown again, so that the heartbeat continues. ``make`` returns the
    current status, ``publish`` sends one, ``when_durable`` is that of the journal, and ``changed`` is called when the
    shown status is no longer the newest.
    """

    def __init__(
        self,
        runtime: Runtime,
        make: Callable[[], StatusPicture],
        publish: Callable[[StatusPicture], None],
        when_durable: Callable[[Callable[[], object]], None],
        changed: Callable[[], None],
    ) -> None:
        """Must be called before anything happens: what was found in the journal is durable."""
        self._picture = make()
        self._runtime = runtime
        self._make = make
        self._publish = publish
        self._when_durable = when_durable
        self._changed = changed
        self._to_show: deque[Callable[[], None]] = deque()
        self._is_waiting = False
        self._is_outdated = False

    @property
    def message(self) -> ExecutiveStatus:
        """Return what is shown, or is going to be shown first."""
        return self._picture.status

    def show(self, publish: Callable[[], None]) -> None:
        """Have ``publish`` called when the journal has all that has happened so far, in the order of these calls."""
        self._to_show.append(publish)
        self._when_durable(lambda: self._on_executor(self._show_next))

    def refresh(self) -> None:
        """Show the current status as soon as possible, until then the previous one."""
        if self._is_waiting:
            self._is_outdated = True
            self._publish(self._picture)
            return
        self._is_waiting = True
        picture = self._make()
        self.show(lambda: self._show(picture))

    def _show_next(self) -> None:
        # The first one suffices, whichever is reported: everything before it is durable as well.
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
            self._changed()


# When the status goes out: at once on a change, as a heartbeat while nothing changes, and never too often.

MAXIMUM_RATE: Final = 20.0
"""Maximum average rate of messages, 1/s."""

BURST: Final = 4
"""Messages that may go out at once after a quiet time, so that a command's answer and its effect are not held back."""


class StatusPublisher:
    """A publisher that calls ``send`` on the executor thread: soon after :meth:`changed`, and every ``period`` seconds
    of wall time.

    Changes that come faster than the rate allows are put together.
    """

    def __init__(self, runtime: Runtime, send: Callable[[], None], period: float) -> None:
        self._runtime = runtime
        self._send = send
        self._lock = threading.Lock()
        self._is_due = False
        self._delay: Timer | None = None
        self._credit = float(BURST)
        self._credit_time = runtime.steady.now()
        # Wall time: the heartbeat goes on while simulated time stands still or has not begun.
        self._heartbeat = runtime.node.create_timer(
            period, self._send_now, clock=Clock(clock_type=ClockType.STEADY_TIME)
        )

    def changed(self) -> None:
        """Something in the status has changed; from any thread."""
        with self._lock:
            if self._is_due:
                return
            self._is_due = True
        self._runtime.post(self._send_when_allowed)

    def flush(self) -> None:
        """Send now, if something has changed that was not sent; on the executor thread."""
        if self._is_due:
            self._send_now()

    def _send_when_allowed(self) -> None:
        if not self._is_due:
            return
        wait = (1.0 - self._refilled()) / MAXIMUM_RATE
        if wait <= 0.0:
            self._send_now()
        elif self._delay is None:
            self._delay = self._runtime.post_in(wait, self._delay_is_over)

    def _delay_is_over(self) -> None:
        self._delay = None
        self._send_when_allowed()

    def _send_now(self) -> None:
        if self._delay is not None:
            self._delay.cancel()
            self._delay = None
        with self._lock:
            self._is_due = False  # before sending: what changes from here on is another message
        self._credit = max(0.0, self._refilled() - 1.0)
        self._heartbeat.reset()
        self._send()

    def _refilled(self) -> float:
        now = self._runtime.steady.now()
        self._credit = min(float(BURST), self._credit + (now - self._credit_time) * MAXIMUM_RATE)
        self._credit_time = now
        return self._credit
