# SPDX-License-Identifier: BSD-3-Clause
"""The ledger of commands, which knows each command from its arrival until its result is dropped.

A command is admitted once, no matter how often it is sent, and has its effect at most once. It is decided when it has
had its effect or is refused. The decision is journaled first, and then written to the event log and reported in the
status. After a restart of the executive, the journal provides earlier decisions.
"""

from __future__ import annotations

import math
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
"""Maximum number of results in a status (ExecutiveStatus.results)."""

OPEN_COMMANDS: Final = 100
"""Maximum number of commands of one writer that may wait for their effect. A blocked behavior applies none."""

REPORT_TIME: Final = 5.0
"""Seconds for which a result is part of every status. A console that has missed it resends the command, and the result
is reported again. Without this limit, old results would be most of the traffic of a quiet link."""


@dataclass(frozen=True)
class _Open:
    command: ExecutiveCommand
    writer: bytes


class CommandHandling:
    """Base of the handlers of commands. It refuses every command, with the same reason."""

    def __init__(self, refusal: str = '') -> None:
        self._refusal = refusal

    def is_addressed(self, _command: ExecutiveCommand) -> bool:
        """Return whether a command is for this executive. The results of another executive are unknown here."""
        return True

    def fields(self, _command: ExecutiveCommand) -> dict[str, Any]:
        """Return the fields of the command for the event log."""
        return {}

    def apply(self, _command: ExecutiveCommand, _writer: bytes, _arrived: float) -> bool:
        """Apply a command that :meth:`CommandLedger.receive` has got. Return True if it has had its effect.

        After False, :class:`CommandDecided`, :class:`RunBuilt` or :class:`RunRefused` follows.

        Raises:
            CommandRefusedError: the command has no effect; the text is the reason.
        """
        raise CommandRefusedError(self._refusal)


class CommandLedger(RunReader):
    """The commands of one executive. Used on the executor thread, except :meth:`read`.

    The runs notify it, as one of their readers, when a command has taken effect. It triggers ``status`` when a result
    is to be reported, or when a sender meant another executive.
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
        # A command without a result is open: admitted, but not decided. Its entry has the writer.
        self._entries: OrderedDict[str, CommandResult | _Open] = OrderedDict()
        self._nameless = RepeatedReports(COMPLAINT_SECONDS, now)
        self._reported: OrderedDict[str, float] = OrderedDict()  # ids, and the time of the last report of each result
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

    def receive(self, command: ExecutiveCommand, writer: bytes = b'', arrived: float = math.inf) -> None:
        """Handle a command. The status reports its result. ``writer`` has sent it; b'' if unknown. ``arrived`` is the
        time of its arrival on the steady clock, s; infinity if unknown."""
        if not 0 < len(command.id) <= COMMAND_LENGTHS['id']:
            if command.kind != ExecutiveCommand.STOP:
                self._ignore_nameless(command)
                return
            command.id = uuid.uuid4().hex  # apply the STOP anyway, although its result cannot be reported
        known = self._entries.get(command.id)
        excess = excess_of_command(command)
        if known is None and self._handling.is_addressed(command):
            if excess and command.kind == ExecutiveCommand.STOP:
                self._admit(_bare(command, excess), writer, arrived)  # which stops the robot all the same
            elif excess:
                self._settle(command.id, excess, self._handling.fields(_bare(command)))
            else:
                self._admit(command, writer, arrived)  # sending a status first would only delay the effect
            return
        if known is None:
            fields = self._handling.fields(_bare(command) if excess else command)
            self._report.command(fields, 'ignored', 'meant for another executive')
        elif isinstance(known, CommandResult):  # a resend is answered again, but not applied again
            self._report_result(command.id)
        self._status.changed()

    def results(self) -> list[CommandResult]:
        """Return the results for the status, oldest first."""
        oldest = self._now() - REPORT_TIME
        while self._reported and next(iter(self._reported.values())) < oldest:
            self._reported.popitem(last=False)
        entries = [self._entries.get(command_id) for command_id in self._reported]
        return [entry for entry in entries if isinstance(entry, CommandResult)]

    def _ignore_nameless(self, command: ExecutiveCommand) -> None:
        """Ignore a command without a valid id, which cannot be answered, and log it."""
        if self._nameless.held_before('') is None:
            return
        length = len(command.id)
        why = f'its id has {length} characters, and may have {COMMAND_LENGTHS["id"]}' if length else 'it has no id'
        operator = one_line(command.operator_id, COMMAND_LENGTHS['operator_id'])
        self._report.log(ExecutiveLog.WARN, f'a command of operator {operator!r} was ignored: {why}')
        self._report.command({'operator': operator, 'kind': command.kind}, 'ignored', why)

    def _admit(self, command: ExecutiveCommand, writer: bytes, arrived: float) -> None:
        command_id = str(command.id)
        of_writer = sum(isinstance(entry, _Open) and entry.writer == writer for entry in self._entries.values())
        self._entries[command_id] = _Open(command, writer)
        self._forget_old()
        try:
            if of_writer >= OPEN_COMMANDS and command.kind != ExecutiveCommand.STOP:
                raise CommandRefusedError(
                    f'{of_writer} commands wait for their effect already; the behavior is held up'
                )
            is_applied = self._handling.apply(command, writer, arrived)
        except CommandRefusedError as error:
            self._decide(command_id, str(error))
        except Exception as error:
            self._decide(command_id, f'fault in the executive: {type(error).__name__}: {error}')
            raise
        else:
            if is_applied:
                self._decide(command_id, None)

    def _decide(self, command_id: str | None, reason: str | None) -> None:
        """Note that a command had its effect (``reason`` None) or is refused. Only the first decision counts."""
        entry = self._entries.get(command_id) if command_id is not None else None
        if command_id is not None and isinstance(entry, _Open):
            self._settle(command_id, reason, self._handling.fields(entry.command))

    def _settle(self, command_id: str, reason: str | None, fields: dict[str, Any]) -> None:
        told = sanitize_for_message(reason or '', REASON_LENGTH)
        code = CommandResult.APPLIED if reason is None else CommandResult.REFUSED
        try:
            self._journal.decide(command_id, reason)
            self._report.command(fields, 'applied' if reason is None else 'refused', told)
        finally:  # answer the sender even if the decision cannot be written
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
            # Skip open commands. They are rarely old, since only a START takes longer than a moment.
            oldest = next((key for key, entry in self._entries.items() if isinstance(entry, CommandResult)), None)
            if oldest is None:
                return
            del self._entries[oldest]


def _bare(command: ExecutiveCommand, reason: str = '') -> ExecutiveCommand:
    """Return a command without the fields that may be too large."""
    operator = one_line(command.operator_id, COMMAND_LENGTHS['operator_id'])
    return ExecutiveCommand(
        id=command.id,
        stamp=command.stamp,
        kind=command.kind,
        operator_id=operator,
        autonomy=command.autonomy,
        reason=reason,
    )
