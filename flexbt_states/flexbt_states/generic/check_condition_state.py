# SPDX-License-Identifier: BSD-3-Clause
"""State that branches on a condition."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from flexbt_core.state_machine import EventState, UserData
from flexbt_states.support import checked_callable


class CheckConditionState(EventState):
    """
    Check a condition. An exception of the function is a fault of the state: it means neither true nor false.

    -- predicate    function    Function of one value, whose result is taken as true or false

    ># input_value              What the function is given.

    <= true                     The condition holds.
    <= false                    The condition does not hold.
    """

    is_instant = True

    def __init__(self, predicate: Callable[[Any], Any]) -> None:
        super().__init__(outcomes=['true', 'false'], input_keys=['input_value'], desired_rate=None)
        self._predicate = checked_callable(self, 'predicate', predicate)

    def execute(self, userdata: UserData) -> str:
        return 'true' if self._predicate(userdata['input_value']) else 'false'
