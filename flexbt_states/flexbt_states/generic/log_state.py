# SPDX-License-Identifier: BSD-3-Clause
"""State that tells the operator something."""

from __future__ import annotations

from flexbt_core.state_machine import EventState, Severity, UserData


class LogState(EventState):
    """
    Tell the operator a line.

    -- text         string      The line
    -- severity     Severity    Its weight

    <= done                     It was told.
    """

    is_instant = True

    def __init__(self, text: str, severity: Severity = Severity.INFO) -> None:
        super().__init__(outcomes=['done'], desired_rate=None)
        self._text = text
        self._severity = Severity(severity)

    def on_enter(self, userdata: UserData) -> None:
        self.log(self._severity, self._text)

    def execute(self, userdata: UserData) -> str:
        return 'done'
