# SPDX-License-Identifier: BSD-3-Clause
"""What the engine says of the machine of a run, for operators and the event log."""

from __future__ import annotations

from collections.abc import Callable

from flexbt_core.state_machine import ExitReason, Severity
from flexbt_msgs.msg import ExecutiveLog

from .run_observer import BehaviorRunObserver
from .run_snapshot import SnapshotSource


class MachineObserver:
    """Observer of one machine; see :class:`flexbt_core.state_machine.RunObserver`.

    ``changed()`` is called for what operators are shown. ``source`` is there from when the machine is.
    """

    def __init__(self, observer: BehaviorRunObserver, changed: Callable[[], None]) -> None:
        self.changed = changed
        self.source: SnapshotSource | None = None
        self.why_ended = ''
        """The error of the state whose outcome ends the machine."""
        self._observer = observer
        self._errors: dict[str, str] = {}  # of the active states, the last of each

    def log(self, severity: Severity, path: str, text: str) -> None:
        """A line for the operator."""
        if severity is Severity.ERROR:
            self._errors[path] = text
        self._observer.log(severity.value, path, text)

    def fault(self, path: str, text: str) -> None:
        """A state raised, or did not halt."""
        self._observer.log(ExecutiveLog.ERROR, path, text)
        self._observer.event('fault', {'path': path, 'text': text})

    def transition(self, path: str, outcome: str, target: str, reason: ExitReason) -> None:
        """A state or machine was left."""
        if self.source is not None:
            self.source.left(path)
        fields = {'path': path, 'outcome': outcome, 'target': target, 'reason': reason.name.lower()}
        self._observer.event('left', fields)
        error = self._errors.pop(path, '') if reason is not ExitReason.FORCED else ''
        if target.startswith('/'):
            self.why_ended = ''  # it goes on, whatever it was
        elif error:
            self.why_ended = f'{path}: {error}'
        if reason is ExitReason.FORCED:
            # Told of what is around: it is no reason for what a state wants that is entered again at that moment.
            around, _, label = path.rpartition('/')
            text = f'{label} left by {outcome!r}, as the operator wants it'
            self._observer.log(ExecutiveLog.INFO, around or '/', text)
            self._warn_of_unwritten(path, outcome, target)

    def _warn_of_unwritten(self, path: str, outcome: str, target: str) -> None:
        """A state that was forced out has not written what it writes otherwise; what follows may read it."""
        keys = self.source.machine.unwritten(target) if self.source is not None and target.startswith('/') else []
        if keys:
            text = f'by {outcome!r}, which was forced, {target} follows, and reads what nobody has written'
            self._observer.log(ExecutiveLog.WARN, path, f'{text}: {", ".join(keys)}')
