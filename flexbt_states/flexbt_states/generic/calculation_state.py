# SPDX-License-Identifier: BSD-3-Clause
"""State that computes a value."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from flexbt_core.state_machine import EventState, UserData
from flexbt_states.support import checked_callable


class CalculationState(EventState):
    """
    Compute a value from another. An exception of the function is a fault of the state.

    -- calculation  function    Function of one value

    ># input_value              What the function is given.
    #> output_value             What the function returns.

    <= done                     The value was computed.
    """

    is_instant = True

    def __init__(self, calculation: Callable[[Any], Any]) -> None:
        super().__init__(outcomes=['done'], input_keys=['input_value'], output_keys=['output_value'], desired_rate=None)
        self._calculation = checked_callable(self, 'calculation', calculation)

    def execute(self, userdata: UserData) -> str:
        userdata['output_value'] = self._calculation(userdata['input_value'])
        return 'done'
