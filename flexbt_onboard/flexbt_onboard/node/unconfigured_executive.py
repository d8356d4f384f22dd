# SPDX-License-Identifier: BSD-3-Clause
"""What consoles see of an executive that is not configured: that it is there, and why it does nothing."""

from __future__ import annotations

import uuid

from flexbt_common.lifecycle import unconfigured
from flexbt_common.runtime import NodeRuntime
from flexbt_msgs.msg import ExecutiveCommand, ExecutiveLog, ExecutiveStatus
from flexbt_onboard.commands.command_table import CommandTable
from flexbt_onboard.link.operator_link import OperatorLink
from flexbt_onboard.link.status_publisher import StatusPublisher

from .executive_parameters import ExecutiveParameters


class UnconfiguredExecutive:
    """The operator link of an executive that does not know its behaviors: every command is refused, with the reason."""

    def __init__(self, runtime: NodeRuntime) -> None:
        """Must be called off the executor thread."""
        self._refusal = f'the executive {unconfigured(runtime.node)}'
        self._commands = CommandTable()
        runtime.call(lambda: self._open(runtime, ExecutiveParameters().heartbeat_period))

    def _open(self, runtime: NodeRuntime, heartbeat_period: float) -> None:
        self._link = OperatorLink(runtime, uuid.uuid4().hex, heartbeat_period, self._refuse)
        self._status = StatusPublisher(runtime, self._publish, heartbeat_period)
        self._link.log(ExecutiveLog.WARN, self._refusal)
        self._status.changed()

    def _refuse(self, command: ExecutiveCommand) -> None:
        if command.id and self._commands.admit(command.id):
            self._commands.settle(command.id, self._refusal)
        self._status.changed()

    def _publish(self) -> None:
        self._link.publish_status(
            ExecutiveStatus(state=ExecutiveStatus.IDLE, message=self._refusal, results=self._commands.latest())
        )
