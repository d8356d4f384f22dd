# SPDX-License-Identifier: BSD-3-Clause
"""State that waits."""

from __future__ import annotations

import math

from flexbt_core.state_machine import EventState, UserData
from flexbt_states.errors import StateParameterError


class WaitState(EventState):
    """
    Wait for some time on the node's clock.

    -- wait_time    float       Seconds to wait

    <= done                     The time has passed.
    """

    def __init__(self, wait_time: float) -> None:
        super().__init__(outcomes=['done'], desired_rate=None)
        if not isinstance(wait_time, int | float) or not math.isfinite(wait_time) or wait_time < 0.0:
            raise StateParameterError(self, 'wait_time', f'{wait_time!r} is not a number of seconds')
        self._wait_time = float(wait_time)
        self.skill = self.skill.lasting(self._wait_time, self._wait_time)
        self._end = 0.0

    def on_enter(self, userdata: UserData) -> None:
        self._end = self.clock.now() + self._wait_time
        self.wake_at(self._end)

    def execute(self, userdata: UserData) -> str | None:
        if self.clock.now() >= self._end:
            return 'done'
        self.wake_at(self._end)
        return None
