# SPDX-License-Identifier: BSD-3-Clause
"""FlexBE's state that branches in several ways."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any

from flexbt_core.skills import Outcome, OutcomeClass
from flexbt_core.state_machine import UserData
from flexbt_flexbe.api import EventState
from flexbt_states.support import checked_callable, checked_outcomes


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
