# SPDX-License-Identifier: BSD-3-Clause
"""State that tells the operator a value."""

from __future__ import annotations

from string import Formatter

from flexbt_core.state_machine import EventState, Severity, UserData
from flexbt_states.errors import StateParameterError


class LogKeyState(EventState):
    """
    Tell the operator a value of the userdata.

    -- text         string      The line, with one {} where the value shall be
    -- severity     Severity    Its weight

    ># data                     The value.

    <= done                     It was told.
    """

    is_instant = True

    def __init__(self, text: str, severity: Severity = Severity.INFO) -> None:
        super().__init__(outcomes=['done'], input_keys=['data'], desired_rate=None)
        try:
            fields = [field for _, field, _, _ in Formatter().parse(text) if field is not None]
        except ValueError as error:
            raise StateParameterError(self, 'text', f'{text!r}: {error}') from None
        if fields not in ([''], ['0']):
            raise StateParameterError(self, 'text', f'{text!r} must have one {{}} for the value')
        self._text = text
        self._severity = Severity(severity)

    def on_enter(self, userdata: UserData) -> None:
        self.log(self._severity, self._text.format(userdata['data']))

    def execute(self, userdata: UserData) -> str:
        return 'done'
