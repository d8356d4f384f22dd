# SPDX-License-Identifier: BSD-3-Clause
"""The executive on ``/diagnostics``: the behavior, the nodes that it depends on, and what is written to the disk."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Final

from diagnostic_msgs.msg import DiagnosticStatus

from flexbt_common.lifecycle import DiagnosticsPublisher, diagnostic_status
from flexbt_common.runtime import NodeRuntime
from flexbt_msgs.msg import ExecutiveStatus

_STATES: Final = {
    ExecutiveStatus.IDLE: 'idle',
    ExecutiveStatus.STARTING: 'starting',
    ExecutiveStatus.RUNNING: 'running',
    ExecutiveStatus.PAUSED: 'paused',
    ExecutiveStatus.STOPPING: 'stopping',
    ExecutiveStatus.INTERRUPTED: 'interrupted',
}


class Diagnostics:
    """Publishes three entries: the behavior, the nodes that it depends on, and what is written to the disk.

    ``status`` gives the present status of the executive, ``problems`` what is wrong with event log and journal.
    """

    def __init__(
        self, runtime: NodeRuntime, status: Callable[[], ExecutiveStatus], problems: Mapping[str, str]
    ) -> None:
        self._runtime = runtime
        self._status = status
        self._problems = problems
        DiagnosticsPublisher(runtime, self._entries)

    def _entries(self) -> list[DiagnosticStatus]:
        status = self._status()
        return [self._behavior(status), self._peers(status), self._storage()]

    def _behavior(self, status: ExecutiveStatus) -> DiagnosticStatus:
        state = _STATES.get(status.state, 'unknown')
        what = f'{status.behavior} ended: {status.outcome}' if status.outcome else status.behavior
        level, message = DiagnosticStatus.OK, ' '.join(filter(None, [state, what]))
        if status.state == ExecutiveStatus.IDLE and status.outcome == 'error':
            level, message = DiagnosticStatus.ERROR, f'{message}: {status.message}'
        elif status.state == ExecutiveStatus.INTERRUPTED:
            level = DiagnosticStatus.WARN
        elif status.state == ExecutiveStatus.STOPPING and status.message:
            level, message = DiagnosticStatus.ERROR, f'{message}: {status.message}'
        elif status.decisions:
            level = DiagnosticStatus.WARN
            message += f'; waits for the operator: {", ".join(one.path for one in status.decisions)}'
        values = {
            'run': status.run_id,
            'active states': ', '.join(one.path for one in status.active_states),
            'decisions': str(len(status.decisions)),
            'autonomy': str(status.autonomy),
            'authority': status.authority,
        }
        return diagnostic_status(self._runtime, 'behavior', level, message, values)

    def _peers(self, status: ExecutiveStatus) -> DiagnosticStatus:
        gone = [one.name for one in status.peers if one.expected and not one.alive]
        unready = [one.name for one in status.peers if one.alive and not one.ready]
        level, message = DiagnosticStatus.OK, 'all ready'
        if gone:
            level, message = DiagnosticStatus.ERROR, f'not alive: {", ".join(gone)}'
        elif unready:
            level, message = DiagnosticStatus.WARN, f'not ready: {", ".join(unready)}'
        return diagnostic_status(
            self._runtime,
            'nodes',
            level,
            message,
            {one.name: 'not alive' if not one.alive else 'ready' if one.ready else 'not ready' for one in status.peers},
        )

    def _storage(self) -> DiagnosticStatus:
        wrong = {name: text for name, text in self._problems.items() if text}
        level = DiagnosticStatus.WARN if wrong else DiagnosticStatus.OK
        return diagnostic_status(
            self._runtime, 'event log and journal', level, '; '.join(wrong.values()) or 'written', wrong
        )
