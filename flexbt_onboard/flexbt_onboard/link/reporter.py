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

    ``texts`` has it by what the file is; '' for nothing. ``changed`` is called when it changes.
    """

    def __init__(self, log: Callable[..., None], changed: Callable[[], None] = lambda: None) -> None:
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
        """ID of the run that goes on, for lines that concern it."""
        self._event_log = event_log
        self._stream = stream

    def event(self, event: str, **fields: Any) -> None:
        """Write an event."""
        self._event_log.add(event, **fields)
        if self._stream is not None:
            self._stream.add(event, fields)

    def command(self, fields: Mapping[str, Any], effect: str, why: str = '') -> None:
        """Report what became of a command: applied, refused or ignored."""
        self.event('command', **fields, effect=effect, why=why)

    def operators(self, text: str, is_warning: bool) -> None:
        """Report consoles that have connected or disconnected, and the reaction."""
        self.log(ExecutiveLog.WARN if is_warning else ExecutiveLog.INFO, text)
        self.event('operator', text=text)
