# SPDX-License-Identifier: BSD-3-Clause
"""The executable ``onboard_executive``, and the status that it sends to consoles while it is not configured."""

from __future__ import annotations

import sys
import uuid

from flexbt_common import names
from flexbt_common.lifecycle.managed_node import run_managed_node, unconfigured
from flexbt_common.runtime.node_runtime import Runtime
from flexbt_msgs.msg import ExecutiveLog, ExecutiveStatus
from flexbt_onboard.commands.command_ledger import CommandHandling, CommandLedger
from flexbt_onboard.link.console_link import ConsoleLink
from flexbt_onboard.link.reporter import Reporter, StorageProblems
from flexbt_onboard.link.status_publisher import StatusPublisher
from flexbt_onboard.persistence.event_log import EventLog
from flexbt_onboard.persistence.run_journal import RunJournal

from .executive import Executive, open_executive
from .executive_parameters import ExecutiveParameters, declare_parameters


def configure(runtime: Runtime, refusal: str) -> Executive:
    """Make the executive from the parameters of the node."""
    parameters = runtime.call(lambda: declare_parameters(runtime.node))
    executive = open_executive(runtime, parameters, refusal=refusal)
    runtime.node.get_logger().info(f'configured; behaviors: {", ".join(executive.library.entries) or "none installed"}')
    return executive


def main(args: list[str] | None = None) -> int:
    """Run the node until SIGINT or SIGTERM; return the exit code of the process."""
    return run_managed_node(names.ONBOARD_EXECUTIVE, configure, args, show_unconfigured, declare_parameters, __doc__)


# Consoles see that an executive that is not configured exists, and why it does nothing.


def show_unconfigured(runtime: Runtime) -> UnconfiguredExecutive:
    """Show consoles that the executive of this node is not configured. Do not call on the executor thread."""
    return runtime.call(lambda: UnconfiguredExecutive(runtime))


class UnconfiguredExecutive(StatusPublisher):
    """The operator link of an executive that is not configured. It refuses every command, with the reason."""

    def __init__(self, runtime: Runtime) -> None:
        """Call on the executor thread."""
        period = ExecutiveParameters().heartbeat_period
        super().__init__(runtime, period)
        self._refusal = f'the executive {unconfigured(runtime.node)}'
        self._link = ConsoleLink(runtime, uuid.uuid4().hex, period)
        problems = StorageProblems(self._link.log)
        journal = RunJournal(None, problems.of('journal', ExecutiveLog.ERROR), runtime.steady)
        event_log = EventLog(None, runtime.clock, runtime.steady, problems.of('event log', ExecutiveLog.WARN))
        report = Reporter(self._link.log, event_log)
        self._ledger = CommandLedger(runtime, CommandHandling(self._refusal), journal, report, self)
        self._link.listen(self._ledger.receive)
        self._link.log(ExecutiveLog.WARN, self._refusal)
        self.changed()

    def send(self) -> None:
        """Send the status: idle, with the reason."""
        self._link.publish_status(
            ExecutiveStatus(state=ExecutiveStatus.IDLE, message=self._refusal, results=self._ledger.results())
        )


if __name__ == '__main__':
    sys.exit(main())
