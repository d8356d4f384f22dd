# SPDX-License-Identifier: BSD-3-Clause
"""The ledger of commands: each lives here from its arrival until its result is forgotten.

A command is admitted once, however often it is sent, and has its effect at most once. It is decided when the effect has
come or it is refused; that is journaled before it is written to the event log and reported in the status. Decisions
before a restart of the executive are remembered from the journal.
"""

from __future__ import annotations

import time
import uuid
from collections import OrderedDict
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any, Final

from flexbt_common.middleware.received_messages import COMPLAINT_SECONDS
from flexbt_common.runtime.node_runtime import Runtime
from flexbt_core.clock.rates import RepeatedReports
from flexbt_core.state_machine.engine.events import CommandDecided, RunEvent, RunReader
from flexbt_core.values.text import one_line, sanitize_for_message
from flexbt_msgs.msg import CommandResult, ExecutiveCommand, ExecutiveLog
from flexbt_onboard.errors import CommandRefusedError
from flexbt_onboard.link.reporter import Reporter
from flexbt_onboard.link.status_publisher import StatusPublisher
from flexbt_onboard.persistence.journal import REMEMBERED_COMMANDS
from flexbt_onboard.persistence.run_journal import REASON_LENGTH, RunJournal
from flexbt_onboard.runs.run_events import RunBuilt, RunRefused

from .command_bounds import COMMAND_LENGTHS, excess_of_command

REPORTED_RESULTS: Final = 32
"""Results that are part of a status at most (ExecutiveStatus.results)."""

OPEN_COMMANDS: Final = 100
"""Maximum number of commands of one writer that may wait for their effect: a behavior that is held up applies none."""

REPORT_TIME: Final = 5.0
"""Seconds for which a result is part of every status. A console that has lost it sends the command again, and so has it
reported again; without this limit most of a quiet link's traffic would be old results."""


@dataclass(frozen=True)
class _Open:
    command: ExecutiveCommand
    writer: bytes


class CommandHandling:
    """The handling of the commands. This one refuses each of them, with a reason."""

    def __init__(self, refusal: str = '') -> None:
        self._refusal = refusal

    def is_addressed(self, _command: ExecutiveCommand) -> bool:
        """Return whether a command is for this executive, which cannot know what another one made of it."""
        return True

    def fields(self, _command: ExecutiveCommand) -> dict[str, Any]:
        """Return what the command says, for the event log."""
        return {}

    def apply(self, _command: ExecutiveCommand, _writer: bytes) -> bool:
        """Return whether it has had its effect; otherwise :class:`CommandDecided` or the begin of a run follows.

        Raises:
            CommandRefusedError: it has no effect; the text is the reason.
        """
        raise CommandRefusedError(self._refusal)


class CommandLedger(RunReader):
    """The commands of one executive. Used on the executor thread, except :meth:`read`.

    As a reader of the runs it is notified when a command has taken effect. ``status`` is sent when a result is to be
    reported, or a sender has to be notified that this is another executive.
    """

    def __init__(
        self,
        runtime: Runtime,
        handling: CommandHandling,
        journal: RunJournal,
        report: Reporter,
        status: StatusPublisher,
        remembered: int = REMEMBERED_COMMANDS,
        now: Callable[[], float] = time.monotonic,
    ) -> None:
        self._post = runtime.post
        self._handling = handling
        self._journal = journal
        self._report = report
        self._status = status
        self._remembered = remembered
        self._now = now
        # A command without a result is open: admitted, and not decided. The entry says who has written it.
        self._entries: OrderedDict[str, CommandResult | _Open] = OrderedDict()
        self._nameless = RepeatedReports(COMPLAINT_SECONDS, now)
        self._reported: OrderedDict[str, float] = OrderedDict()  # results, and when each was reported last
        for result in journal.results:
            self._entries[result.command_id] = result
        self._forget_old()

    def read(self, event: RunEvent) -> None:
        match event:
            case CommandDecided(str(command_id), refusal):
                self._post(partial(self._decide, command_id, refusal))
            case RunBuilt(request):
                self._post(partial(self._decide, request.command_id, None))
            case RunRefused(request, reason):
                self._post(partial(self._decide, request.command_id, reason))

    def receive(self, command: ExecutiveCommand, writer: bytes = b'') -> None:
        """Take a command in, whatever it is; its result is part of the status. ``writer`` has sent it, b'': unknown."""
        if not 0 < len(command.id) <= COMMAND_LENGTHS['id']:
            if command.kind != ExecutiveCommand.STOP:
                self._ignore_nameless(command)
                return
            command.id = uuid.uuid4().hex  # it stops anyway, but its result cannot be reported
        known = self._entries.get(command.id)
        excess = excess_of_command(command)
        if known is None and self._handling.is_addressed(command):
            if excess and command.kind == ExecutiveCommand.STOP:
                self._admit(_bare_stop(command, excess), writer)
            elif excess:
                self._refuse_unkept(command, excess)
            else:
                self._admit(command, writer)  # a status now would only hold up its effect
            return
        if excess:
            return
        if known is None:
            self._report.command(self._handling.fields(command), 'ignored', 'meant for another executive')
        elif isinstance(known, CommandResult):  # a resend: answered again, applied once
            self._report_result(command.id)
        self._status.changed()

    def results(self) -> list[CommandResult]:
        """Return the results that are to be reported, oldest first."""
        oldest = self._now() - REPORT_TIME
        while self._reported and next(iter(self._reported.values())) < oldest:
            self._reported.popitem(last=False)
        entries = [self._entries.get(command_id) for command_id in self._reported]
        return [entry for entry in entries if isinstance(entry, CommandResult)]

    def _ignore_nameless(self, command: ExecutiveCommand) -> None:
        """Ignore a command that cannot be answered."""
        if self._nameless.held_before('') is None:
            return
        length = len(command.id)
        why = f'its id has {length} characters, and may have {COMMAND_LENGTHS["id"]}' if length else 'it has no id'
        operator = one_line(command.operator_id, COMMAND_LENGTHS['operator_id'])
        self._report.log(ExecutiveLog.WARN, f'a command of operator {operator!r} was ignored: {why}')
        self._report.command({'operator': operator, 'kind': command.kind}, 'ignored', why)

    def _refuse_unkept(self, command: ExecutiveCommand, reason: str) -> None:
        """Nothing of it is kept but its id."""
        operator = one_line(command.operator_id, COMMAND_LENGTHS['operator_id'])
        self._settle(command.id, reason, {'id': command.id, 'operator': operator, 'kind': command.kind})

    def _admit(self, command: ExecutiveCommand, writer: bytes) -> None:
        command_id = str(command.id)
        of_writer = sum(isinstance(entry, _Open) and entry.writer == writer for entry in self._entries.values())
        self._entries[command_id] = _Open(command, writer)
        self._forget_old()
        try:
            if of_writer >= OPEN_COMMANDS and command.kind != ExecutiveCommand.STOP:
                raise CommandRefusedError(
                    f'{of_writer} commands wait for their effect already; the behavior is held up'
                )
            is_applied = self._handling.apply(command, writer)
        except CommandRefusedError as error:
            self._decide(command_id, str(error))
        except Exception as error:
            self._decide(command_id, f'fault in the executive: {type(error).__name__}: {error}')
            raise
        else:
            if is_applied:
                self._decide(command_id, None)

    def _decide(self, command_id: str | None, reason: str | None) -> None:
        """Note that a command had its effect (None), or is refused; the first decision counts."""
        entry = self._entries.get(command_id) if command_id is not None else None
        if command_id is not None and isinstance(entry, _Open):
            self._settle(command_id, reason, self._handling.fields(entry.command))

    def _settle(self, command_id: str, reason: str | None, fields: dict[str, Any]) -> None:
        told = sanitize_for_message(reason or '', REASON_LENGTH)
        code = CommandResult.APPLIED if reason is None else CommandResult.REFUSED
        try:
            self._journal.decide(command_id, reason)
            self._report.command(fields, 'applied' if reason is None else 'refused', told)
        finally:  # whatever cannot be written: who gave it is answered
            self._entries[command_id] = CommandResult(command_id=command_id, code=code, reason=told)
            self._forget_old()
            self._report_result(command_id)
            self._status.changed()

    def _report_result(self, command_id: str) -> None:
        self._reported[command_id] = self._now()
        self._reported.move_to_end(command_id)
        while len(self._reported) > REPORTED_RESULTS:
            self._reported.popitem(last=False)

    def _forget_old(self) -> None:
        while len(self._entries) > self._remembered:
            # A command that is not decided yet is never the oldest by far: only a START takes longer than a moment.
            oldest = next((key for key, entry in self._entries.items() if isinstance(entry, CommandResult)), None)
            if oldest is None:
                return
            del self._entries[oldest]


def _bare_stop(command: ExecutiveCommand, excess: str) -> ExecutiveCommand:
    """Return a STOP with a field that is too large: it stops anyway, and its other fields are left out."""
    operator = one_line(command.operator_id, COMMAND_LENGTHS['operator_id'])
    return ExecutiveCommand(id=command.id, stamp=command.stamp, kind=command.kind, operator_id=operator, reason=excess)
