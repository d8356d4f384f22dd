# SPDX-License-Identifier: BSD-3-Clause
"""Start, supervise and end runs, one at a time, also when no operator has been there for some time."""

from __future__ import annotations

import uuid
from collections.abc import Callable
from dataclasses import dataclass, replace

from flexbt_common.calls.goal_server import GoalAdmission
from flexbt_common.lifecycle.presence import PresenceWatch
from flexbt_common.runtime.node_runtime import Runtime
from flexbt_common.values.limits import LONG_TEXT
from flexbt_core.clock.clock import Timer
from flexbt_core.monitors.monitoring import Monitoring
from flexbt_core.state_machine.engine.operator_commands import CommandReply
from flexbt_core.state_machine.engine.run import MachineRun
from flexbt_core.state_machine.model.definition import PREEMPTED
from flexbt_core.values.text import sanitize_for_message
from flexbt_msgs.msg import BehaviorStructure
from flexbt_onboard.behaviors.behavior import OperatorGone
from flexbt_onboard.behaviors.run_building import RunRequest
from flexbt_onboard.behaviors.run_context import StateServices
from flexbt_onboard.errors import CommandRefusedError
from flexbt_onboard.persistence.reporter import Reporter
from flexbt_onboard.persistence.run_journal import InterruptedRun, RunJournal

from .behavior_run import BehaviorRun
from .run_observers import RunRecorder
from .run_snapshot import RunEnd, RunSnapshot
from .stop_enforcer import StopEnforcer

Ended = Callable[[RunEnd], None]


@dataclass(frozen=True)
class LastRun:
    """The run before, while none goes on; empty before the first. ``autonomy`` is the level for the next one."""

    autonomy: int
    run_id: str = ''
    behavior: str = ''
    outcome: str = ''
    message: str = ''


ShownRun = RunSnapshot | InterruptedRun | LastRun
"""The run that operators see: the one that goes on, was interrupted, or was the last."""


@dataclass(frozen=True)
class StatusSink:
    """Where operators see the run.

    ``publish_structure`` sends the structure of a run, before the next status; both when the journal has all that has
    happened. ``changed`` is told, from any thread, that the status has changed; ``flush`` sends it now, if it has.
    """

    publish_structure: Callable[[BehaviorStructure], None]
    changed: Callable[[], None]
    flush: Callable[[], None]


def _nobody(*_told: object) -> None:
    """Nobody waits for it."""


class RunSupervisor:
    """Used on the executor thread; a run has a thread of its own and posts here what becomes of it.

    ``admission`` says why nothing can be started.
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
        display: StatusSink,
        autonomy: int,
        monitoring: Monitoring,
    ) -> None:
        self.run: BehaviorRun | None = None
        """The run that goes on."""
        self._runtime = runtime
        self._services = services
        self._admission = admission
        self._journal = journal
        self._report = report
        self._operators = operators
        self._stops = stops
        self._display = display
        self._monitoring = monitoring
        known = journal.next_autonomy
        self._last = LastRun(autonomy if known is None else known)

    @property
    def snapshot(self) -> RunSnapshot | None:
        """The run that goes on."""
        return self.run.snapshot if self.run is not None else None

    @property
    def interrupted(self) -> InterruptedRun | None:
        """The run that the end of the executive interrupted, until an operator decides about it."""
        return self._journal.interrupted if self.run is None else None

    @property
    def shown(self) -> ShownRun:
        """The run that operators see."""
        return self.snapshot or self.interrupted or self._last

    def set_next_autonomy(self, level: int) -> None:
        """The level for the next run."""
        self._journal.set_next_autonomy(level)
        self._last = replace(self._last, autonomy=level)
        self._display.changed()

    def start(
        self, request: RunRequest, answer: CommandReply, ended: Ended = _nobody, run_id: str | None = None
    ) -> BehaviorRun:
        """Begin a run; ``answer`` gets None when the behavior is built, or the reason why it cannot be.

        ``ended`` gets how a run that was built has ended. Both are called on the executor thread. ``run_id`` is that
        of the interrupted run that is to go on.

        Raises:
            CommandRefusedError: the executive is not active, a run goes on, or another one was interrupted.
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
        owner = _Listener(self, self._runtime, self._display, answer, ended)
        recorder = RunRecorder(run_id, request.entry.name, answer, self._journal, self._report, owner)
        self._stops.begins()
        owner.run = self.run = BehaviorRun(
            request, run_id, self._services, recorder, self._stops.timeout, self._monitoring
        )
        self.run.start()
        self._display.changed()
        return self.run

    def stop(self, why: str) -> BehaviorRun | None:
        """Stop the run that goes on, if there is one."""
        if self.run is not None:
            self.run.stop(why)
        return self.run

    def halt_robot(self) -> None:
        """Stop whatever drives the robot, beside the run that goes on, if there is one."""
        self._stops.halt_robot(self.run is not None)

    def abort(self, interrupted: InterruptedRun, why: str) -> None:
        """An interrupted run does not go on."""
        self._journal.end(interrupted.run_id, why)
        self._report.run_ended(interrupted.run_id, interrupted.behavior, PREEMPTED, why)
        self._show_last(interrupted.run_id, interrupted.behavior, PREEMPTED, why)

    def began(self, run: BehaviorRun, structure: BehaviorStructure, answer: CommandReply) -> None:
        """The behavior of a run is built."""
        # The structure first: a status that names its run can be drawn at once.
        self._display.publish_structure(structure)
        run.announce()
        self._operators.watch_over(run)
        answer(None)
        self._display.flush()

    def switched(self, run: BehaviorRun, structure: BehaviorStructure) -> None:
        """A run goes on with another behavior, which may want something else when no operator is there."""
        self._display.publish_structure(structure)
        if run is self.run:
            self._operators.watch_over(run)

    def stopping(self, run: BehaviorRun) -> None:
        """A run was told to stop."""
        if run is self.run:
            self._stops.stopping(run)

    def ended(self, run: BehaviorRun, outcome: str, message: str) -> None:
        """A run has ended, or could not begin."""
        self.run = None
        self._operators.watch_over(None)
        last = run.snapshot
        self._journal.set_next_autonomy(last.autonomy)
        self._last = replace(self._last, autonomy=last.autonomy)
        self._show_last(last.run_id, last.behavior, outcome, message)

    def _show_last(self, run_id: str, behavior: str, outcome: str, message: str) -> None:
        self._last = LastRun(self._last.autonomy, run_id, behavior, outcome, sanitize_for_message(message, LONG_TEXT))
        self._display.changed()


class _Listener:
    """Who has started a run: the supervisor, for a command or a program. Called on the thread of the run."""

    run: BehaviorRun

    def __init__(
        self, supervisor: RunSupervisor, runtime: Runtime, display: StatusSink, answer: CommandReply, ended: Ended
    ) -> None:
        self._supervisor = supervisor
        self._post = runtime.post
        self._display = display
        self._answer = answer
        self._ended = ended
        self.run_changed = display.changed

    def run_began(self, structure: BehaviorStructure) -> None:
        """See :class:`RunListener`."""
        self._post(lambda: self._supervisor.began(self.run, structure, self._answer))

    def run_refused(self, reason: str) -> None:
        """See :class:`RunListener`."""

        def tell() -> None:
            self._supervisor.ended(self.run, '', reason)  # no outcome: it has not run
            self._answer(reason)

        self._post(tell)

    def run_switched(self, structure: BehaviorStructure) -> None:
        """See :class:`RunListener`."""
        self._post(lambda: self._supervisor.switched(self.run, structure))

    def run_stopping(self) -> None:
        """See :class:`RunListener`."""
        self._post(lambda: self._supervisor.stopping(self.run))

    def run_ended(self, end: RunEnd) -> None:
        """See :class:`RunListener`."""

        def tell() -> None:
            self._supervisor.ended(self.run, end.outcome, end.message)
            self._ended(end)

        self._post(tell)


# What happens to a run when no operator has been there for some time: what its behavior wants then.


class OperatorAbsenceWatch:
    """Watches whether any console is there. Used on the executor thread only.

    ``presence`` tells who is there. ``tell`` gets a line for the operator, and whether it is a warning. A run that
    goes on anyway tells nothing of it: programs that ask and go would fill the log.
    """

    def __init__(self, runtime: Runtime, presence: PresenceWatch, tell: Callable[[str, bool], None]) -> None:
        self._runtime = runtime
        self._tell = tell
        self._run: BehaviorRun | None = None
        self._timer: Timer | None = None
        self._presence = presence
        self._was_there = False
        presence.add_listener(self._changed)

    def watch_over(self, run: BehaviorRun | None) -> None:
        """A run begins, or has ended (None). The time without an operator counts from its beginning on."""
        self._run = run
        self._set_timer()

    def _changed(self) -> None:
        is_there = bool(self._presence.present)
        if is_there is self._was_there:
            return
        self._was_there = is_there
        if self._run is not None and self._run.snapshot.operator_gone is not OperatorGone.CONTINUE:
            self._tell('an operator is there' if is_there else 'no operator is there any more', not is_there)
        self._set_timer()

    def _set_timer(self) -> None:
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None
        run = self._run
        if run is None or self._presence.present or run.snapshot.operator_gone is OperatorGone.CONTINUE:
            return
        seconds = run.snapshot.operator_gone_after
        self._timer = self._runtime.post_in(seconds, lambda: self._time_is_over(run))

    def _time_is_over(self, run: BehaviorRun) -> None:
        if run is not self._run or self._presence.present:
            return
        self._timer = None
        shown = run.snapshot
        why = f'no operator was there for {shown.operator_gone_after:g} s'
        if shown.operator_gone is OperatorGone.STOP:
            self._tell(f'{why}: behavior {shown.behavior!r} is stopped', True)
            run.stop(why)
        else:
            self._tell(f'{why}: behavior {shown.behavior!r} is paused until an operator resumes it', True)
            run.command(MachineRun.pause, lambda _reason: None)  # when it is paused already, so much the better
