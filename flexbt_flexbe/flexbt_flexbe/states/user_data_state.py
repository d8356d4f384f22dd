# SPDX-License-Identifier: BSD-3-Clause
"""FlexBE's state that writes a value to userdata."""

from __future__ import annotations

from typing import Any

from flexbt_core.state_machine import UserData
from flexbt_flexbe.api import EventState


class UserdataState(EventState):
    """
    Write a value to userdata.

    -- data         object      The value

    #> data                     The value.

    <= done                     It was written.
    """

    is_instant = True

    def __init__(self, data: Any) -> None:
        super().__init__(outcomes=['done'], output_keys=['data'], desired_rate=None)
        self._data = data

    def execute(self, userdata: UserData) -> str:
        userdata['data'] = self._data
        return 'done'
