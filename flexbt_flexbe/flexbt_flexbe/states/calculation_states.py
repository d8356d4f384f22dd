# SPDX-License-Identifier: BSD-3-Clause
"""FlexBE's states that compute a value, from one or from several."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import flexbt_states
from flexbt_core.state_machine import UserData
from flexbt_flexbe.api import EventState, RosAccess
from flexbt_states.errors import StateParameterError
from flexbt_states.support import checked_callable

from .call_styles import takes_keywords, takes_list


class CalculationState(RosAccess, flexbt_states.CalculationState):
    __doc__ = flexbt_states.CalculationState.__doc__


class FlexibleCalculationState(EventState):
    """
    Compute a value from several. An exception of the function is a fault of the state.

    -- calculation  function    Function that takes each of input_keys as a keyword; or else one list of the values
    -- input_keys   string[]    Keys whose values it is given

    ># KEY                      Each of input_keys.
    #> output_value             What the function returns.

    <= done                     The value was computed.
    """

    is_instant = True

    def __init__(self, calculation: Callable[..., Any], input_keys: Sequence[str]) -> None:
        super().__init__(outcomes=['done'], input_keys=input_keys, output_keys=['output_value'], desired_rate=None)
        self._calculation = checked_callable(self, 'calculation', calculation)
        self._by_keyword = takes_keywords(calculation, self.input_keys)
        if not self._by_keyword and not takes_list(calculation):
            raise StateParameterError(
                self, 'calculation', f'takes neither one list nor the keywords {", ".join(self.input_keys)}'
            )

    def execute(self, userdata: UserData) -> str:
        if self._by_keyword:
            value = self._calculation(**{key: userdata[key] for key in self.input_keys})
        else:
            value = self._calculation([userdata[key] for key in self.input_keys])
        userdata['output_value'] = value
        return 'done'
