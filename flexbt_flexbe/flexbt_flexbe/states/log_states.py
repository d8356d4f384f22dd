# SPDX-License-Identifier: BSD-3-Clause
"""FlexBE's states that tell the operator a text, or a value."""

from __future__ import annotations

from flexbt_core.state_machine import UserData
from flexbt_flexbe.api import EventState, Logger


class LogState(EventState):
    """
    Tell the operator something.

    -- text         object      What to tell; shown as text
    -- severity     uint8       Logger.REPORT_DEBUG, _INFO, _HINT, _WARN or _ERROR

    <= done                     It was told.
    """

    is_instant = True

    def __init__(self, text: object, severity: int = Logger.REPORT_HINT) -> None:
        super().__init__(outcomes=['done'], desired_rate=None)
        self._text = text
        self._severity = severity

    def on_enter(self, userdata: UserData) -> None:
        Logger.log(self._text, self._severity)

    def execute(self, userdata: UserData) -> str:
        return 'done'


class LogKeyState(EventState):
    """
    Tell the operator a value.

    -- text         string      What to tell, with {} where the value goes, as in str.format
    -- severity     uint8       Logger.REPORT_DEBUG, _INFO, _HINT, _WARN or _ERROR

    ># data                     The value.

    <= done                     It was told.
    """

    is_instant = True

    def __init__(self, text: str, severity: int = Logger.REPORT_HINT) -> None:
        super().__init__(outcomes=['done'], input_keys=['data'], desired_rate=None)
        self._text = text
        self._severity = severity

    def on_enter(self, userdata: UserData) -> None:
        Logger.log(self._text.format(userdata['data']), self._severity)

    def execute(self, userdata: UserData) -> str:
        return 'done'
