# SPDX-License-Identifier: BSD-3-Clause
"""FlexBE's states that branch on a value, or on several."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from typing import Any

import flexbt_states
from flexbt_core.skills import Outcome, OutcomeClass
from flexbt_core.state_machine import UserData
from flexbt_flexbe.api import EventState, RosAccess
from flexbt_states.errors import StateParameterError
from flexbt_states.support import checked_callable, checked_outcomes

from .call_styles import takes_keywords, takes_list


class CheckConditionState(RosAccess, flexbt_states.CheckConditionState):
    __doc__ = flexbt_states.CheckConditionState.__doc__


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


class DecisionState(EventState):
    """
    Leave by the outcome that a function gives. It is asked again, at the state's rate, as long as it gives None.

    -- outcomes     string[]    What there is to choose from
    -- conditions   function    Function of one value; gives an outcome, or None to wait

    ># input_value              What the function is given.

    <= OUTCOME                  Each of outcomes: the function gave it. Another name is a fault of the state.
    """

    def __init__(self, outcomes: Iterable[str], conditions: Callable[[Any], str | None]) -> None:
        names = checked_outcomes(self, 'outcomes', outcomes)
        super().__init__(outcomes=names, input_keys=['input_value'])
        self.skill = self.skill.completed_by('', {name: Outcome(OutcomeClass.ANSWERED) for name in names})
        self._conditions = checked_callable(self, 'conditions', conditions)

    def execute(self, userdata: UserData) -> str | None:
        outcome = self._conditions(userdata['input_value'])
        return None if outcome is None else str(outcome)
