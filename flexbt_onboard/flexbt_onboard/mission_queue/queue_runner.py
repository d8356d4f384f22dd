# SPDX-License-Identifier: BSD-3-Clause
"""The runner of the mission queue, which starts the next entry when no behavior runs, and shows the queue."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from typing import Final

from flexbt_common.calls.goal_server import GoalAdmission
from flexbt_common.runtime.node_runtime import Runtime
from flexbt_common.values.message_fields import options_message, options_of, seconds_of, time_message
from flexbt_core.clock.clock import Timer
from flexbt_core.state_machine.engine.events import RunEvent, RunReader
from flexbt_core.state_machine.model.definition import ERROR, PREEMPTED
from flexbt_core.values.text import truncate_middle
from flexbt_msgs.msg import BehaviorArgument, BlackboardEntry, ExecutiveCommand, ExecutiveLog, MissionQueue
from flexbt_msgs.msg import QueueEntry as QueueEntryMessage
from flexbt_onboard.behaviors.behavior_library import BehaviorLibrary
from flexbt_onboard.behaviors.run_building import check_given, run_request
from flexbt_onboard.errors import CommandRefusedError
from flexbt_onboard.link.reporter import Reporter
from flexbt_onboard.persistence.queue_entries import Change, EndedRun, QueueEntry
from flexbt_onboard.persistence.run_journal import RunJournal
from flexbt_onboard.runs.run_events import RunOver, RunRefused, RunRequested
from flexbt_onboard.runs.run_supervisor import RunSupervisor

from .conditions import StartConditions, check_options
from .mission_queue import MissionQueue as Queue

PERIOD: Final = 1.0
"""Time between two checks of the conditions while an entry waits for them, s of wall time."""

SHOWN: Final = 20
"""Maximum number of arguments, and of inputs, of an entry that operators see."""

SHOWN_TEXT: Final = 200
"""Maximum characters of a value that operators see."""


class QueueRunner(RunReader):
    """The runner of the mission queue. Used on the executor thread, as the events that it reads.

    It takes an entry only while no run is active or interrupted, and the journal can be written: the run of an entry is
    journaled before its first state is entered. ``journal_problem`` returns why the journal cannot be written, and
    ``changed`` is called when operators have to see something new.
    """

    reads = (RunRequested, RunOver)

    def __init__(
        self,
        runtime: Runtime,
        library: BehaviorLibrary,
        runs: RunSupervisor,
        admission: GoalAdmission,
        journal: RunJournal,
        report: Reporter,
        conditions: StartConditions,
        journal_problem: Callable[[], str],
        changed: Callable[[], None],
    ) -> None:
        self._runtime = runtime
        self._library = library
        self._runs = runs
        self._admission = admission
        self._report = report
        self._conditions = conditions
        self._journal_problem = journal_problem
        self._changed = changed
        self._journal = journal
        self._command_id: str | None = None
        self._queue = Queue(journal.state.queue, self._write)
        self._waits: dict[int, str] = {}
        self._started: float | None = None
        self._timer: Timer | None = None
        self._message: MissionQueue | None = None
        self._recover(journal.corruption)

    # -- what operators see -------------------------------------------------------------------------------------------

    @property
    def message(self) -> MissionQueue:
        """The queue for operators; the same object until it changes."""
        if self._message is None:
            state, running = self._queue.state, self._queue.running
            entries = [_entry_message(one, running, self._waits.get(one.number, '')) for one in state.entries.values()]
            self._message = MissionQueue(hold=state.hold, held=state.held, entries=entries)
        return self._message

    @property
    def has_entries(self) -> bool:
        """True if something waits or runs."""
        return bool(self._queue.state.entries)

    @property
    def behaviors(self) -> set[str]:
        """Names of the behaviors of the entries."""
        return {entry.behavior for entry in self._queue.state.entries.values()}

    @property
    def running(self) -> int:
        """Number of the entry that runs or was interrupted; 0 for none."""
        return self._queue.running

    # -- commands -----------------------------------------------------------------------------------------------------

    @contextmanager
    def changing(self, command_id: str | None = None) -> Iterator[Queue]:
        """Yield the queue for changes, which operators see afterwards.

        A command is journaled as applied in the line of its change, so that a resend after a crash changes nothing.
        """
        self._command_id, hold = command_id, self._queue.state.hold
        try:
            yield self._queue
        finally:
            self._command_id = None
        if self._queue.state.hold != hold:
            self._tell_hold()
        self._after_change()

    def _write(self, change: Change) -> None:
        command_id, self._command_id = self._command_id, None
        self._journal.change_queue(change, command_id)

    def new_entry(self, command: ExecutiveCommand) -> QueueEntry:
        """Return the entry that a command adds.

        Raises:
            CommandRefusedError: the behavior or an option is not valid, or the entry would be lost in a crash.
        """
        if problem := self._journal_problem():
            raise CommandRefusedError(f'the entry would be lost in a crash: {problem}')
        return self._entry(command, command.behavior)

    def changed_entry(self, command: ExecutiveCommand) -> QueueEntry:
        """Return an entry as a command changes it; without arguments or inputs, it keeps those that it has.

        Raises:
            CommandRefusedError: there is no such entry, or something is not valid.
        """
        entry = self._queue.entry(command.queue_number)
        return replace(self._entry(command, entry.behavior), number=entry.number, revision=command.queue_revision)

    def _entry(self, command: ExecutiveCommand, behavior: str) -> QueueEntry:
        given = tuple((one.name, one.value) for one in command.arguments)
        request = run_request(self._library, behavior, given, command.inputs, command.autonomy, command.operator_id)
        check_given(request)
        options = options_of(command.queue_options[0])
        check_options(options, self._conditions.places)
        return QueueEntry(
            0,
            request.entry.name,
            options,
            given,
            tuple(request.inputs),
            request.autonomy,
            request.by,
            self._now(),
        )

    def hold(self, why: str) -> None:
        """Start no further entry."""
        with self.changing() as queue:
            queue.hold(why)

    # -- runs ---------------------------------------------------------------------------------------------------------

    def read(self, event: RunEvent) -> None:
        match event:
            case RunRequested(request):
                self._queue.running, self._started = request.queue_entry, self._now()
                self._after_change()
            case RunOver(RunRefused(message=message, is_stopped=True)):
                self._ended(PREEMPTED, message, is_forced=False)  # no failure of the entry
            case RunOver(end):
                self._ended(end.outcome, end.message, is_forced=end.is_forced)

    def consider(self) -> None:
        """Start the next entry if one can start. Call it after any change that may allow a start."""
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None
        obstacle = self._obstacle()
        now = self._now()
        waits = {
            number: obstacle or self._conditions.obstacle(entry, now)
            for number, entry in self._queue.state.entries.items()
            if number != self._queue.running
        }
        if waits != self._waits:
            self._waits, self._message = waits, None
            self._changed()
        entry = None if obstacle else self._queue.next(lambda one: waits[one.number])
        if entry is not None:
            self._start(entry)
        elif waits and (not obstacle or self._journal_problem()):
            self._timer = self._runtime.post_in(PERIOD, self.consider)

    def _obstacle(self) -> str:
        """Return why no entry can start; '' if nothing prevents it except the conditions of each."""
        if self._queue.state.hold:
            return 'the queue is held'
        if self._admission.refusal:
            return self._admission.refusal
        if self._runs.run is not None:
            return 'a behavior runs'
        if self._runs.interrupted is not None:
            return 'a run was interrupted; resume or abort it'
        return 'the journal cannot be written' if self._journal_problem() else ''

    def _start(self, entry: QueueEntry) -> None:
        by = f'{entry.operator or "an operator"} (entry {entry.number} of the queue)'
        try:
            request = run_request(self._library, entry.behavior, entry.arguments, entry.inputs, entry.autonomy, by)
            self._runs.start(replace(request, queue_entry=entry.number))
        except CommandRefusedError as error:
            self._queue.running = entry.number
            self._ended('', str(error), is_forced=False)

    def _ended(self, outcome: str, message: str, *, is_forced: bool) -> None:
        interrupted = self._runs.interrupted
        if interrupted is not None:  # it was to be resumed, and still waits for that
            self._queue.running = interrupted.queue_entry
        elif self._queue.running:
            self._settle(EndedRun(self._queue.running, outcome, message, is_forced))
        elif self._queue.state.entries and (outcome == ERROR or is_forced):
            self.hold(f'a run ended by {outcome!r}' + (f': {message}' if message else ''))
        # Another turn of the executor: all others have to read the end of this run before the next one starts.
        self._runtime.post(self._after_change)

    def _settle(self, end: EndedRun) -> None:
        why = self._queue.settle(end, self._now(), self._started)
        self._started = None
        if why:
            self._tell_hold()
        elif end.number not in self._queue.state.entries:
            self._tell(f'entry {end.number} of the queue is done', end.number)

    def _recover(self, corruption: str) -> None:
        """Continue after a restart. Entries may start once the executive is active."""
        state, interrupted = self._queue.state, self._runs.interrupted
        if state.ended is not None:  # the executive was killed between the end of the run and what follows from it
            self._settle(state.ended)
        if corruption and state.entries:
            self.hold('the journal is corrupt: which entries have run is not known')
        if interrupted is not None and interrupted.queue_entry:
            self._queue.running = interrupted.queue_entry
            try:
                interrupted.position()
                run_request(self._library, interrupted.behavior, (), (), 0, '')
            except CommandRefusedError as error:
                self.hold(f'entry {interrupted.queue_entry} ran when the executive ended, and cannot continue: {error}')
        if state.entries:
            self._runtime.post(self.consider)

    # -- helpers ------------------------------------------------------------------------------------------------------

    def _now(self) -> float:
        return seconds_of(self._runtime.clock.stamp())

    def _after_change(self) -> None:
        self._message = None
        self._changed()
        self.consider()

    def _tell_hold(self) -> None:
        text = f'the queue is held: {self._queue.state.held}' if self._queue.state.hold else 'the queue is released'
        self._tell(text, severity=ExecutiveLog.WARN if self._queue.state.hold else ExecutiveLog.INFO)

    def _tell(self, text: str, number: int = 0, severity: int = ExecutiveLog.INFO) -> None:
        self._report.log(severity, text)
        self._report.event('queue', entry=number, text=text)


def _entry_message(entry: QueueEntry, running: int, waits_for: str) -> QueueEntryMessage:
    plain = ('number', 'revision', 'behavior', 'autonomy', 'runs', 'failures', 'outcome', 'message')
    return QueueEntryMessage(
        **{name: getattr(entry, name) for name in plain},
        arguments=[
            BehaviorArgument(name=name, value=truncate_middle(value, SHOWN_TEXT))
            for name, value in entry.arguments[:SHOWN]
        ],
        inputs=[
            BlackboardEntry(key=one.key, type=one.type, text=truncate_middle(one.text, SHOWN_TEXT))
            for one in entry.inputs[:SHOWN]
        ],
        options=options_message(entry.options),
        operator_id=entry.operator,
        added=time_message(entry.added),
        running=entry.number == running,
        due=time_message(entry.due),
        waits_for='' if entry.number == running else waits_for,
    )
