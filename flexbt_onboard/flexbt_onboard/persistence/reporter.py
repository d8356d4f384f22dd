# SPDX-License-Identifier: BSD-3-Clause
"""The reporter of what happens on the robot: lines for the operators, and events for the event log."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any, Protocol

from flexbt_core.state_machine.model.definition import ERROR
from flexbt_msgs.msg import ExecutiveLog
from flexbt_onboard.behaviors.behavior_library import BehaviorEntry
from flexbt_onboard.behaviors.run_building import RunRequest

from .event_log import EventLog


class OperatorLog(Protocol):
    """A log that sends a line to every operator and to the node's own log; from any thread."""

    def __call__(self, severity: int, text: str, path: str = '', run_id: str = '') -> None:
        """``severity`` is one of ExecutiveLog, ``path`` that of the state that reports."""


class StorageProblems:
    """The problems of the files that the executive writes, logged when they begin and end. From any thread.

    ``texts`` has it by what the file is; '' for nothing. ``changed`` is called when it changes.
    """

    def __init__(self, log: OperatorLog, changed: Callable[[], None] = lambda: None) -> None:
        self.texts: dict[str, str] = {}
        self._log = log
        self._changed = changed

    @property
    def text(self) -> str:
        """All that is wrong; '' for nothing."""
        return '; '.join(filter(None, self.texts.values()))

    def of(self, file: str, severity: int) -> Callable[[str], None]:
        """Take what is wrong with a file, such as 'event log'; '' when it can be written again."""

        def tell(text: str) -> None:
            self.texts[file] = text
            self._log(severity if text else ExecutiveLog.INFO, text or f'the {file} is written again')
            self._changed()

        return tell


class Reporter:
    """A reporter of events to operators and to the event log. From any thread.

    ``log`` sends the operators a line that is not an event. ``stream`` gets each event by its name and fields, and
    sends the operators those that are for them.
    """

    def __init__(
        self,
        log: OperatorLog,
        event_log: EventLog,
        stream: Callable[[str, Mapping[str, Any]], None] = lambda event, fields: None,
    ) -> None:
        self.log = log
        self._event_log = event_log
        self._stream = stream

    def event(self, event: str, **fields: Any) -> None:
        """Write an event."""
        self._event_log.add(event, **fields)
        self._stream(event, fields)

    # -- the executive ------------------------------------------------------------------------------------------------

    def broken(self, entry: BehaviorEntry) -> None:
        """Report that an installed behavior cannot be run."""
        self.log(ExecutiveLog.WARN, f'behavior {entry.name!r} of {entry.package} is broken: {entry.error}')

    def interrupted(self, run_id: str, behavior: str, active: Sequence[str]) -> None:
        """Report a run that the end of the executive has interrupted."""
        self.log(
            ExecutiveLog.WARN,
            f'behavior {behavior!r} was interrupted by the end of the executive in '
            f'{", ".join(active) or "its beginning"}; an operator has to resume or abort it',
            run_id=run_id,
        )

    def fault(self, error: BaseException) -> None:
        """Report an exception that escaped from a callback of the executive."""
        self.log(ExecutiveLog.ERROR, f'fault in the executive, which goes on: {type(error).__name__}: {error}')

    # -- operators ----------------------------------------------------------------------------------------------------

    def command(self, fields: Mapping[str, Any], effect: str, why: str = '') -> None:
        """Report what became of a command: applied, refused or ignored."""
        self.event('command', **fields, effect=effect, why=why)

    def note(self, operator: str, text: str, run_id: str) -> None:
        """Pass on a remark of an operator to the others; the event log has it as a command."""
        self.log(ExecutiveLog.INFO, f'{operator or "an operator"} notes: {text}', run_id=run_id)

    def authority(self, holder: str, requests: Sequence[str], text: str) -> None:
        """Report that another operator has the authority to command, or asks for it."""
        self.log(ExecutiveLog.INFO, text)
        self.event('authority', holder=holder, requests=list(requests), text=text)

    def operators(self, text: str, is_warning: bool) -> None:
        """Report consoles that have connected or disconnected, and the reaction."""
        self.log(ExecutiveLog.WARN if is_warning else ExecutiveLog.INFO, text)
        self.event('operator', text=text)

    # -- runs ---------------------------------------------------------------------------------------------------------

    def run_started(self, run_id: str, request: RunRequest) -> None:
        """Report that a behavior is built and begins, or continues after a restart of the executive."""
        name = request.entry.name
        self.event(
            'started' if request.at is None else 'resumed',
            run=run_id,
            behavior=name,
            arguments=dict(request.arguments),
            inputs=[entry.key for entry in request.inputs],
            autonomy=request.autonomy,
            by=request.by,
        )
        what = 'started' if request.at is None else 'goes on; its active states are entered again'
        self.log(ExecutiveLog.INFO, f'behavior {name!r} {what}', run_id=run_id)

    def run_refused(self, run_id: str, behavior: str, reason: str) -> None:
        """Report that a behavior could not be built."""
        self.event('refused', run=run_id, behavior=behavior, why=reason)
        self.log(ExecutiveLog.ERROR, f'behavior {behavior!r} cannot start: {reason}', run_id=run_id)

    def run_switched(self, run_id: str, request: RunRequest) -> None:
        """Report that a run continues with another behavior."""
        arguments = dict(request.arguments)
        self.event('switched', run=run_id, behavior=request.entry.name, arguments=arguments, by=request.by)

    def run_ended(self, run_id: str, behavior: str, outcome: str, message: str) -> None:
        """Report that a run has ended, and everything has halted, or what ``message`` does not name."""
        self.event('ended', run=run_id, behavior=behavior, outcome=outcome, message=message)
        severity = ExecutiveLog.ERROR if outcome == ERROR else ExecutiveLog.INFO
        text = f'behavior {behavior!r} ended with {outcome!r}' + (f': {message}' if message else '')
        self.log(severity, text, run_id=run_id)

    def not_journaled(self, run_id: str, type_name: str) -> None:
        """Report that the userdata of a run has a value that the journal cannot hold."""
        self.log(
            ExecutiveLog.WARN,
            f'the userdata has a {type_name}, which cannot be journaled: the run could not go on after a crash',
            run_id=run_id,
        )
