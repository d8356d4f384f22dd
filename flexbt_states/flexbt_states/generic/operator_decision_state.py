# SPDX-License-Identifier: BSD-3-Clause
"""State that lets the operator decide."""

from __future__ import annotations

from collections.abc import Iterable

from flexbt_core.skills import Outcome, OutcomeClass
from flexbt_core.state_machine import EventState, UserData
from flexbt_states.errors import StateParameterError
from flexbt_states.support import checked_keys, checked_outcomes


class OperatorDecisionState(EventState):
    """
    Let the operator choose how to go on.

    -- outcomes     string[]    What there is to choose from
    -- hint         string      What to consider, for the operator; may be empty
    -- suggestion   string      Outcome that is taken without asking where the autonomy allows it; None to ask always
    -- shows        string[]    Userdata keys that the operator is shown, such as a path; empty: all of the machine

    ># KEY                      Each of shows: what the operator judges.

    <= OUTCOME                  Each of outcomes: the operator has chosen it.
    """

    def __init__(
        self,
        outcomes: Iterable[str],
        hint: str | None = None,
        suggestion: str | None = None,
        shows: Iterable[str] = (),
    ) -> None:
        names = checked_outcomes(self, 'outcomes', outcomes)
        super().__init__(outcomes=names, input_keys=checked_keys(self, 'shows', shows), desired_rate=None)
        self.skill = self.skill.completed_by('', {name: Outcome(OutcomeClass.ANSWERED) for name in names})
        suggestion = suggestion or None
        if suggestion is not None and suggestion not in names:
            raise StateParameterError(self, 'suggestion', f'{suggestion!r} is none of {", ".join(names)}')
        self._hint = hint or ''
        self.suggestion = suggestion

    def on_enter(self, userdata: UserData) -> None:
        self.ask(self._hint, self.suggestion)
