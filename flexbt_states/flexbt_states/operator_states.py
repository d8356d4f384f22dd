# SPDX-License-Identifier: BSD-3-Clause
"""States that let the operator decide, or ask the operator for a value."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

from flexbt_common import names
from flexbt_common.calls.action_call import GoalOutcome, GoalStatus
from flexbt_common.values.decision_subject import subject_message
from flexbt_common.values.entries import check_value, from_entry, text_to_value
from flexbt_core.errors import FlexbtError
from flexbt_core.skills.skill import Outcome, OutcomeClass
from flexbt_core.state_machine.model.event_state import EventState
from flexbt_core.state_machine.model.userdata import UserData
from flexbt_msgs.action import OperatorInput

from .errors import StateParameterError
from .goal_call import GoalState
from .parameter_checks import checked_keys, checked_list, checked_outcomes, checked_text, checked_type


class OperatorDecisionState(EventState):
    """
    Ask the operator for the outcome.

    -- outcomes     string[]    Outcomes to choose from
    -- hint         string      Advice for the operator; may be empty
    -- suggestion   string      Outcome used without asking if the autonomy level allows it; None to always ask
    -- shows        string[]    Userdata keys to show to the operator, such as a path; empty for all of the machine

    ># KEY                      Each of shows: a value that the operator judges.

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
        self._hint = checked_text(self, 'hint', hint or '')
        self.suggestion = suggestion

    def on_enter(self, userdata: UserData) -> None:
        self.ask(self._hint, self.suggestion)


# State that asks the operator for a value.


class OperatorInputState(GoalState):
    """
    Ask the operator for a typed value, such as a goal pose. Leaving the state withdraws the input request.

    -- prompt       string      Text of the input request
    -- type         string      Type of the value, e.g. geometry_msgs/msg/PoseStamped
    -- choices      string[]    Allowed answers; empty for any value of the type
    -- timeout      float       Seconds (wall time) to wait for the answer; None for no limit
    -- topic        string      Name of the action of the executive that asks
    -- shows        string[]    Userdata keys to show to the operator with the question

    ># KEY                      Each of shows.

    #> data                     The answer: a value of the type.

    <= received                 The operator has answered.
    <= declined                 The operator has declined to answer.
    <= failed                   No operator could be asked, or no answer arrived in time; the reason is logged.
    """

    def __init__(
        self,
        prompt: str,
        type: str,
        choices: Sequence[str] = (),
        timeout: float | None = None,
        topic: str = names.OPERATOR_INPUT,
        shows: Iterable[str] = (),
    ) -> None:
        super().__init__(
            OperatorInput,
            topic,
            timeout,
            not_paused=tuple,  # a question may stay open while the state is paused: nothing moves
            outcomes=['received', 'declined', 'failed'],
            input_keys=checked_keys(self, 'shows', shows),
            output_keys=['data'],
        )
        self._prompt = checked_text(self, 'prompt', prompt)
        self._type = checked_type(self, 'type', type)
        self._choices = checked_list(self, 'choices', choices, 'texts')
        for text in self._choices:
            try:
                text_to_value(checked_text(self, 'choices', text), self._type)
            except FlexbtError as error:
                raise StateParameterError(self, 'choices', str(error)) from None

    def _make_goal(self, userdata: UserData) -> Any:
        shown = {key: userdata[key] for key in self.input_keys if key in userdata}
        missing = [key for key in self.input_keys if key not in shown]
        return OperatorInput.Goal(
            prompt=self._prompt,
            type=self._type,
            choices=self._choices,
            asker=self.path,
            subject=subject_message('', 0, shown, missing),
        )

    def _what(self) -> str:
        return f'no answer to {self._prompt!r}'

    def _end(self, ended: GoalOutcome, userdata: UserData) -> str:
        result = ended.result
        code = result.code if result is not None else OperatorInput.Result.UNKNOWN
        if code == OperatorInput.Result.DECLINED and ended.status in (GoalStatus.SUCCEEDED, GoalStatus.ABORTED):
            return 'declined'
        if ended.status is GoalStatus.SUCCEEDED and code == OperatorInput.Result.SUCCESS and result is not None:
            try:
                userdata['data'] = check_value(from_entry(result.value), self._type)
            except FlexbtError as error:
                self.log_error(f'the answer to {self._prompt!r} cannot be used: {error}')
                return 'failed'
            return 'received'
        message = result.message if result is not None else ''
        why = message or ended.reason or 'the executive did not fill in the result'
        self.log_error(f'{self._what()}: {why}')
        return 'failed'
