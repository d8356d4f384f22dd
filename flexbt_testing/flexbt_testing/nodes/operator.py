# SPDX-License-Identifier: BSD-3-Clause
"""An operator that supervises an executive directly through the topics, for tests without the console."""

from __future__ import annotations

import itertools
import time
import uuid
from collections.abc import Callable, Mapping
from typing import Any

from flexbt_common import names
from flexbt_common.runtime.node_runtime import NodeRuntime
from flexbt_msgs.msg import (
    BehaviorArgument,
    BehaviorList,
    BehaviorStructure,
    CommandResult,
    ExecutiveCommand,
    ExecutiveLog,
    ExecutiveStatus,
    MissionQueue,
)
from flexbt_testing.waiting import RESEND_SECONDS, wait_until


class Operator:
    """An operator that receives all messages of an executive on the node of ``runtime``, and sends it commands."""

    def __init__(self, runtime: NodeRuntime, operator_id: str = 'tester') -> None:
        self.console = runtime
        self.operator_id = operator_id
        self.statuses: list[ExecutiveStatus] = []
        self.arrivals: list[float] = []
        self.structures: list[BehaviorStructure] = []
        self.logs: list[ExecutiveLog] = []
        self.lists: list[BehaviorList] = []
        self.queues: list[MissionQueue] = []
        self.sent: dict[str, ExecutiveCommand] = {}
        self._prefix = f'{uuid.uuid4().hex[:8]}-'
        self._numbers = itertools.count(1)
        self.console.call(self._subscribe)

    def _subscribe(self) -> None:
        node = self.console.node
        for kind, topic, receive in (
            (ExecutiveStatus, names.EXECUTIVE_STATUS, self._on_status),
            (BehaviorStructure, names.EXECUTIVE_STRUCTURE, self.structures.append),
            (ExecutiveLog, names.EXECUTIVE_LOG, self.logs.append),
            (BehaviorList, names.EXECUTIVE_BEHAVIORS, self.lists.append),
            (MissionQueue, names.EXECUTIVE_QUEUE, self.queues.append),
        ):
            node.create_subscription(kind, topic, receive, names.transient_local_qos(100))
        self._commands = node.create_publisher(ExecutiveCommand, names.EXECUTIVE_COMMAND, names.command_qos())
        self._stops = node.create_publisher(ExecutiveCommand, names.EXECUTIVE_STOP, names.stop_qos())

    def _on_status(self, status: ExecutiveStatus) -> None:
        self.arrivals.append(time.monotonic())
        self.statuses.append(status)

    @property
    def status(self) -> ExecutiveStatus:
        """Latest status; before the first one, an empty status with state UNKNOWN."""
        return self.statuses[-1] if self.statuses else ExecutiveStatus()

    @property
    def run_id(self) -> str:
        """Run in the latest status."""
        return str(self.status.run_id)

    @property
    def queue(self) -> MissionQueue:
        """Latest mission queue."""
        return self.queues[-1] if self.queues else MissionQueue()

    def send(self, kind: int, *, id: str = '', **fields: Any) -> str:
        """Send a command for the current run and return its id."""
        fields.setdefault('run_id', '' if kind == ExecutiveCommand.START else self.run_id)
        fields.setdefault('operator_id', self.operator_id)
        command = ExecutiveCommand(id=id or f'{self._prefix}{next(self._numbers)}', kind=kind, **fields)
        self.sent[command.id] = command
        self._publish(command)
        return str(command.id)

    def resend(self, command_id: str) -> None:
        """Send a command again, unchanged."""
        self._publish(self.sent[command_id])

    def _publish(self, command: ExecutiveCommand) -> None:
        """Publish a command as consoles do: a stop goes to a separate topic too."""
        if command.kind == ExecutiveCommand.STOP:
            self._stops.publish(command)
        self._commands.publish(command)

    def result(self, command_id: str) -> CommandResult:
        """Return the result of a command. Resend the command until the result arrives, as consoles do.

        This node may have discovered the executive before the executive has discovered this node.
        """
        sent_at = time.monotonic()

        def find() -> CommandResult | None:
            nonlocal sent_at
            found = next((result for result in self.status.results if result.command_id == command_id), None)
            if found is None and time.monotonic() - sent_at > RESEND_SECONDS:
                sent_at = time.monotonic()
                self.resend(command_id)
            return found

        found = wait_until(find, lambda: f'result of {command_id}; {self.status}')
        assert isinstance(found, CommandResult)
        return found

    def applied(self, kind: int, **fields: Any) -> CommandResult:
        """Send a command, and check that it is applied."""
        result = self.result(self.send(kind, **fields))
        assert result.code == CommandResult.APPLIED, result.reason
        return result

    def refused(self, kind: int, **fields: Any) -> str:
        """Send a command, check that it is refused, and return the reason."""
        result = self.result(self.send(kind, **fields))
        assert result.code == CommandResult.REFUSED
        assert result.reason
        return str(result.reason)

    def start(
        self, behavior: str = 'Test', autonomy: int = 3, arguments: Mapping[str, str] | None = None, **fields: Any
    ) -> str:
        """Start a behavior and return the run id."""
        self.applied(
            ExecutiveCommand.START,
            behavior=behavior,
            autonomy=autonomy,
            arguments=[BehaviorArgument(name=name, value=value) for name, value in (arguments or {}).items()],
            **fields,
        )
        return self.run_id

    def wait_for(self, condition: Callable[[ExecutiveStatus], Any], what: str) -> Any:
        """Wait until a status satisfies the condition, and return the condition's value."""
        return wait_until(lambda: condition(self.status), lambda: f'{what}; last: {self.status}; logs: {self.logs}')

    def wait_for_next_status(self) -> None:
        """Wait for a new status."""
        count = len(self.statuses)
        wait_until(lambda: len(self.statuses) > count, 'next status')

    def wait_connected(self) -> None:
        """Wait until messages arrive in both directions."""
        wait_until(lambda: self.statuses and self._commands.get_subscription_count(), 'an executive')

    def wait_idle(self) -> str:
        """Wait for the end of the run and return its outcome."""
        self.wait_for(lambda status: status.state == ExecutiveStatus.IDLE and status.outcome, 'end of the run')
        return str(self.status.outcome)

    def wait_active(self, path: str) -> None:
        """Wait until the status shows a state as active."""
        self.wait_for(lambda status: path in [state.path for state in status.active_states], f'{path} active')

    def logged(self, text: str) -> ExecutiveLog:
        """Wait for a line that contains the text."""
        found = wait_until(
            lambda: next((line for line in self.logs if text in line.text), None),
            lambda: f'log with {text!r}; have {[line.text for line in self.logs]}',
        )
        assert isinstance(found, ExecutiveLog)
        return found

    def close(self) -> None:
        """Close the node."""
        self.console.close()
