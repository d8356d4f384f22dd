# SPDX-License-Identifier: BSD-3-Clause
"""The reporter of what happens on the robot: lines for the operators, and events for the event log."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from flexbt_msgs.msg import ExecutiveLog
from flexbt_onboard.persistence.event_log import EventLog

from .event_stream import EventStream


class StorageProblems:
    """The problems of the files that the executive writes, logged when they begin and end. From any thread.

    ``texts`` maps the kind of file to its problem, '' for none. ``changed`` is called when a problem changes.
    """

    def __init__(self, log: Callable[..., None], changed: Callable[[], None] = lambda: None) -> None:
        self.texts: dict[str, str] = {}
        self._log = log
        self._changed = changed

    @property
    def text(self) -> str:
        """All problems in one line; '' for none."""
        return '; '.join(filter(None, self.texts.values()))

    def of(self, file: str, severity: int) -> Callable[[str], None]:
        """Return a receiver of the problems of a file, such as 'event log'; '' means that it can be written again."""

        def tell(text: str) -> None:
            self.texts[file] = text
            self._log(severity if text else ExecutiveLog.INFO, text or f'the {file} is written again')
            self._changed()

        return tell


class Reporter:
    """A reporter of events to operators and to the event log. From any thread.

    ``log`` sends the operators a line that is not an event: its severity, a constant of ExecutiveLog, and text, and by
    name the ``path`` of the state that reports and the ``run_id``. ``stream`` gets each event by its name and fields,
    and sends the operators those that are for them.
    """

    def __init__(
        self,
        log: Callable[..., None],
        event_log: EventLog,
        stream: EventStream | None = None,
    ) -> None:
        self.log = log
        self.run_id = ''
        """ID of the current run, for lines that concern it."""
        self._event_log = event_log
        self._stream = stream

    def event(self, event: str, **fields: Any) -> None:
        """Write an event to the event log, and send it to the stream."""
        self._event_log.add(event, **fields)
        if self._stream is not None:
            self._stream.add(event, fields)

    def command(self, fields: Mapping[str, Any], effect: str, why: str = '') -> None:
        """Report the effect of a command: applied, refused or ignored."""
        self.event('command', **fields, effect=effect, why=why)

    def operators(self, text: str, is_warning: bool) -> None:
        """Report consoles that have connected or disconnected, and the reaction."""
        self.log(ExecutiveLog.WARN if is_warning else ExecutiveLog.INFO, text)
        self.event('operator', text=text)
