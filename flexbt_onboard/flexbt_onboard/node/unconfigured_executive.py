# SPDX-License-Identifier: BSD-3-Clause
"""What consoles see of an executive that is not configured: that it is there, and why it does nothing."""

from __future__ import annotations

import uuid
from typing import Any

from flexbt_common.lifecycle import unconfigured
from flexbt_common.runtime import NodeRuntime
from flexbt_core.state_machine import Answer
from flexbt_msgs.msg import ExecutiveCommand, ExecutiveLog, ExecutiveStatus
from flexbt_onboard.commands import CommandLedger
from flexbt_onboard.durability import RunJournal
from flexbt_onboard.errors import CommandRefusedError
from flexbt_onboard.event_log import EventLog, Reporter, StorageProblems
from flexbt_onboard.link import OperatorLink, StatusPublisher

from .executive_parameters import ExecutiveParameters


class UnconfiguredExecutive:
    """The operator link of an executive that does not know its behaviors: every command is refused, with the reason."""

    def __init__(self, runtime: NodeRuntime) -> None:
        """Must be called off the executor thread."""
        self._refusal = f'the executive {unconfigured(runtime.node)}'
        runtime.call(lambda: self._open(runtime, ExecutiveParameters().heartbeat_period))

    def is_addressed(self, _command: ExecutiveCommand) -> bool:
        """Whichever executive it was for: this one is in its place, and has nothing."""
        return True

    def fields(self, _command: ExecutiveCommand) -> dict[str, Any]:
        """There is no event log."""
        return {}

    def apply(self, _command: ExecutiveCommand, _answer: Answer, _writer: bytes) -> bool:
        """Refuse it."""
        raise CommandRefusedError(self._refusal)

    def _open(self, runtime: NodeRuntime, heartbeat_period: float) -> None:
        self._link = OperatorLink(runtime, uuid.uuid4().hex, heartbeat_period)
        self._status = StatusPublisher(runtime, self._publish, heartbeat_period)
        problems = StorageProblems(self._link.log)
        journal = RunJournal('', '', problems.of('journal', ExecutiveLog.ERROR), runtime.steady)
        event_log = EventLog(None, runtime.clock, runtime.steady, problems.of('event log', ExecutiveLog.WARN))
        report = Reporter(self._link.log, event_log)
        self._ledger = CommandLedger(runtime, self, journal, report, self._status.changed)
        self._link.listen(self._ledger.receive)
        self._link.log(ExecutiveLog.WARN, self._refusal)
        self._status.changed()

    def _publish(self) -> None:
        self._link.publish_status(
            ExecutiveStatus(state=ExecutiveStatus.IDLE, message=self._refusal, results=self._ledger.results())
        )
