# SPDX-License-Identifier: BSD-3-Clause
"""FlexBE's state that branches on a condition of several values."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

from flexbt_core.state_machine import UserData
from flexbt_flexbe.api import EventState
from flexbt_states.errors import StateParameterError
from flexbt_states.support import checked_callable

from .call_styles import takes_keywords, takes_list


class FlexibleCheckConditionState(EventState):
    """
    Check a condition of several values. An exception of the function is a fault: it means neither true nor false.

    -- predicate    function    Function that takes one list of the values; or else each of input_keys as a keyword
    -- input_keys   string[]    Keys whose values it is given

    ># KEY                      Each of input_keys.

    <= true                     The condition holds.
    <= false                    The condition does not hold.
    """

    is_instant = True

    def __init__(self, predicate: Callable[..., Any], input_keys: Sequence[str]) -> None:
        super().__init__(outcomes=['true', 'false'], input_keys=input_keys, desired_rate=None)
        self._predicate = checked_callable(self, 'predicate', predicate)
        self._by_list = takes_list(predicate)
        if not self._by_list and not takes_keywords(predicate, self.input_keys):
            raise StateParameterError(
                self, 'predicate', f'takes neither one list nor the keywords {", ".join(self.input_keys)}'
            )

    def execute(self, userdata: UserData) -> str:
        if self._by_list:
            holds = self._predicate([userdata[key] for key in self.input_keys])
        else:
            holds = self._predicate(**{key: userdata[key] for key in self.input_keys})
        return 'true' if holds else 'false'
