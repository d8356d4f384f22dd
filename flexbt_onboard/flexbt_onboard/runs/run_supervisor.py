# SPDX-License-Identifier: BSD-3-Clause
"""The supervision of runs, one at a time, including reactions to the absence of operators."""

from __future__ import annotations

import uuid
from dataclasses import dataclass, replace
from functools import partial

from flexbt_common.calls.goal_server import GoalAdmission
from flexbt_common.lifecycle.presence import PresenceWatch
from flexbt_common.runtime.node_runtime import Runtime
from flexbt_common.values.limits import LONG_TEXT
from flexbt_core.clock.clock import Timer
from flexbt_core.monitors.monitoring import Monitoring
from flexbt_core.state_machine.engine.events import RunEvent, RunReader
from flexbt_core.state_machine.engine.operator_commands import pause
from flexbt_core.state_machine.model.definition import PREEMPTED
from flexbt_core.values.text import sanitize_for_message
from flexbt_onboard.behaviors.behavior import OperatorGone
from flexbt_onboard.behaviors.run_building import RunRequest
from flexbt_onboard.behaviors.run_context import StateServices
from flexbt_onboard.errors import CommandRefusedError
from flexbt_onboard.link.reporter import Reporter
from flexbt_onboard.persistence.run_journal import InterruptedRun, RunJournal

from .behavior_run import BehaviorRun
from .run_events import (
    BehaviorEnded,
    RunBuilt,
    RunMoved,
    RunOver,
    RunReady,
    RunRecorder,
    RunRefused,
    RunRequested,
    RunShown,
    StatusSent,
    StopRequested,
)
from .run_snapshot import RunSnapshot
from .stop_enforcer import StopEnforcer


@dataclass(frozen=True)
class LastRun:
    """The last run, while no run is active; empty before the first. ``autonomy`` is the level for the next run."""

    autonomy: int
    run_id: str = ''
    behavior: str = ''
    outcome: str = ''
    message: str = ''


ShownRun = RunSnapshot | InterruptedRun | LastRun
"""The run that operators see: the current one, the interrupted one, or the last one."""


class RunSupervisor(RunReader):
    """A supervisor that starts runs, one at a time. Used on the executor thread, except :meth:`read`.

    Each run passes its events to the supervisor and then to the ``readers``, in their order. ``admission`` has the
    reason if no run can start.
    """

    def __init__(
        self,
        runtime: Runtime,
        services: StateServices,
        admission: GoalAdmission,
        journal: RunJournal,
        report: Reporter,
        operators: OperatorAbsenceWatch,
        stops: StopEnforcer,
        autonomy: int,
        monitoring: Monitoring,
    ) -> None:
        self.readers: list[RunReader] = []
        self.run: BehaviorRun | None = None
        """Current run; None while idle."""
        self._runtime = runtime
        self._services = services
        self._admission = admission
        self._journal = journal
        self._report = report
        self._operators = operators
        self._stops = stops
        self._monitoring = monitoring
        self._level_of_others: int | None = None
        known = journal.next_autonomy
        self._last = LastRun(autonomy if known is None else known)

    @property
    def snapshot(self) -> RunSnapshot | None:
        """Snapshot of the current run; None while idle."""
        return self.run.snapshot if self.run is not None else None

    @property
    def interrupted(self) -> InterruptedRun | None:
        """Run that the end of the executive interrupted, until an operator resumes or aborts it."""
        return self._journal.interrupted if self.run is None else None

    @property
    def shown(self) -> ShownRun:
        """Run that operators see: the current, the interrupted or the last one."""
        return self.snapshot or self.interrupted or self._last

    def behaviors_in_use(self) -> set[str]:
        """Return the names of the running and of the interrupted behavior."""
        return {one.behavior for one in (self.snapshot, self.interrupted) if one is not None}

    def nodes_changed(self) -> None:
        """Look again at what needs other nodes, since one has appeared, ended, or become ready."""
        self._stops.prepare()
        if self.run is not None:
            self.run.nodes_changed()

    def status_sent(self) -> None:
        """Request the activities of the active states for the next status, and notify the readers."""
        if self.run is not None:
            self.run.ask_activities()
        self._tell(StatusSent())

    def set_next_autonomy(self, level: int) -> None:
        """Set the autonomy level for the next run."""
        self._journal.set_next_autonomy(level)
        self._last = replace(self._last, autonomy=level)
        self._tell(RunShown())

    def start(self, request: RunRequest, run_id: str | None = None) -> BehaviorRun:
        """Start a run. :class:`RunBuilt` or :class:`RunRefused` follows.

        To resume the interrupted run, pass its ``run_id``.

        Raises:
            CommandRefusedError: the executive is not active, a run is active, or another run was interrupted.
        """
        if self._admission.refusal:
            raise CommandRefusedError(self._admission.refusal)
        going_on = self.snapshot
        if going_on is not None:
            raise CommandRefusedError(
                f'behavior {going_on.behavior!r} is {going_on.phase.value} (run {going_on.run_id}); stop it first'
            )
        interrupted = self.interrupted
        if interrupted is not None and interrupted.run_id != run_id:
            raise CommandRefusedError(
                f'behavior {interrupted.behavior!r} was interrupted (run {interrupted.run_id}); '
                'resume or abort it first'
            )
        run_id = run_id or uuid.uuid4().hex
        recorder = RunRecorder(run_id, request.entry.name, self._journal, self._report)
        self._report.run_id = run_id
        self._stops.begins()
        readers = (self, *self.readers)
        stop_timeout = self._stops.timeout
        # A program or the queue says at which level a run begins, not an operator.
        self._level_of_others = request.autonomy if request.queue_entry or not request.is_durable else None
        self.run = BehaviorRun(request, run_id, self._services, recorder, readers, stop_timeout, self._monitoring)
        self.run.start()
        self._tell(RunRequested(request))
        return self.run

    def stop(self, why: str) -> BehaviorRun | None:
        """Stop the current run, and return it; None while idle."""
        if self.run is not None:
            self.run.stop(why)
        return self.run

    def halt_robot(self) -> None:
        """Stop everything that drives the robot, except the current run."""
        self._stops.halt_robot(self.run is not None)

    def abort(self, interrupted: InterruptedRun, why: str) -> None:
        """End an interrupted run, so that it cannot resume."""
        recorder = RunRecorder(interrupted.run_id, interrupted.behavior, self._journal, self._report)
        end = BehaviorEnded(PREEMPTED, why, {})
        recorder.read(end)
        self._show_end(interrupted.run_id, interrupted.behavior, end)

    def read(self, event: RunEvent) -> None:
        match event:
            case RunBuilt() | RunMoved(switched=RunBuilt()):
                self._runtime.post(self._watch_over)
            case RunReady():
                self._runtime.post(self._operators.ready)
            case StopRequested():
                self._runtime.post(partial(self._stopping, self.run))
            case RunRefused() | BehaviorEnded():
                self._runtime.post(partial(self._ended, event))

    def _tell(self, event: RunEvent) -> None:
        for reader in self.readers:
            reader.read(event)

    def _watch_over(self) -> None:
        """Watch over a run that has begun, or has switched to a behavior with another reaction to absent operators."""
        self._operators.watch_over(self.run)

    def _stopping(self, run: BehaviorRun | None) -> None:
        if run is not None and self.run in (run, None):  # it may have ended just before the stop
            self._stops.stopping(run)

    def _ended(self, end: BehaviorEnded | RunRefused) -> None:
        assert self.run is not None  # no other run starts before this one has ended
        last, self.run = self.run.snapshot, None
        self._report.run_id = ''
        self._operators.watch_over(None)
        if last.autonomy != self._level_of_others:
            self._journal.set_next_autonomy(last.autonomy)
            self._last = replace(self._last, autonomy=last.autonomy)
        self._show_end(last.run_id, last.behavior, end)

    def _show_end(self, run_id: str, behavior: str, end: BehaviorEnded | RunRefused) -> None:
        message = sanitize_for_message(end.message, LONG_TEXT)
        self._last = LastRun(self._last.autonomy, run_id, behavior, end.outcome, message)
        self._tell(RunOver(end))


# The reaction of a run to the absence of operators, as its behavior requests.


class OperatorAbsenceWatch:
    """A watch that pauses or stops a run after no operator was connected for some time.

    Used on the executor thread only.

    ``presence`` reports the connected operators. For a run that continues anyway, changes are not reported, since
    programs that connect only briefly would fill the log.
    """

    def __init__(self, runtime: Runtime, presence: PresenceWatch, report: Reporter) -> None:
        self._runtime = runtime
        self._report = report
        self._run: BehaviorRun | None = None
        self._timer: Timer | None = None
        self._is_due = False  # the time was over before the run could be paused
        self._presence = presence
        self._was_there = False
        presence.add_listener(self._changed)

    def watch_over(self, run: BehaviorRun | None) -> None:
        """Watch over a run that begins; None for no run. The time without an operator counts from this call."""
        self._run = run
        self._set_timer()

    def ready(self) -> None:
        """Pause a run that is ready to begin now, if the time was over before."""
        if self._is_due and self._run is not None:
            self._time_is_over(self._run)

    def _changed(self) -> None:
        is_there = bool(self._presence.present)
        if is_there is self._was_there:
            return
        self._was_there = is_there
        if self._run is not None and self._run.snapshot.operator_gone is not OperatorGone.CONTINUE:
            self._report.operators(
                'an operator is there' if is_there else 'no operator is there any more', not is_there
            )
        self._set_timer()

    def _set_timer(self) -> None:
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None
        self._is_due = False
        run = self._run
        if run is None or self._presence.present or run.snapshot.operator_gone is OperatorGone.CONTINUE:
            return
        seconds = run.snapshot.operator_gone_after
        self._timer = self._runtime.post_in(seconds, lambda: self._time_is_over(run))

    def _time_is_over(self, run: BehaviorRun) -> None:
        shown = run.snapshot
        if run is not self._run or self._presence.present or shown.is_stopping:
            return
        self._timer = None
        self._is_due = shown.operator_gone is OperatorGone.HOLD and not shown.has_begun
        if self._is_due:
            return
        why = f'no operator was there for {shown.operator_gone_after:g} s'
        if shown.operator_gone is OperatorGone.STOP:
            self._report.operators(f'{why}: behavior {shown.behavior!r} is stopped', is_warning=True)
            run.stop(why)
        else:
            text = f'{why}: behavior {shown.behavior!r} is paused until an operator resumes it'
            self._report.operators(text, is_warning=True)
            run.command(None, pause)  # refused if the run is paused already
