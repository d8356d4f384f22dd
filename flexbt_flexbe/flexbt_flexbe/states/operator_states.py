# SPDX-License-Identifier: BSD-3-Clause
"""FlexBE's states that ask the operator for a decision or a value."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Final

import flexbt_states
from flexbt_common import names
from flexbt_common.calls.action_call import GoalOutcome, GoalStatus
from flexbt_common.values.entries import check_value, from_entry
from flexbt_core.errors import FlexbtError
from flexbt_core.state_machine.model.userdata import UserData
from flexbt_flexbe.api.event_state import RosAccess
from flexbt_msgs.action import OperatorInput
from flexbt_states.errors import StateParameterError
from flexbt_states.goal_call import GoalState

_TYPES: Final = {
    0: ('int64', None),
    1: ('float64', None),
    2: ('float64[]', 2),
    3: ('float64[]', 3),
    4: ('float64[]', 4),
    10: ('geometry_msgs/msg/Pose', None),
    11: ('geometry_msgs/msg/PoseStamped', None),
    12: ('string', None),
}
"""Type, and number of values, for each request of FlexBE's BehaviorInput: int, float, 2D to 4D, poses, string."""


class OperatorDecisionState(RosAccess, flexbt_states.OperatorDecisionState):
    __doc__ = flexbt_states.OperatorDecisionState.__doc__


class _OperatorInputState(RosAccess, GoalState):
    """The base class of states with one input request, which is open while the state is active."""

    def __init__(self, message: str, input_keys: Sequence[str], topic: str | None) -> None:
        super().__init__(
            OperatorInput,
            topic or names.OPERATOR_INPUT,
            outcomes=['received', 'aborted', 'no_connection', 'data_error'],
            input_keys=input_keys,
            output_keys=['data'],
        )
        self._message = message
        self._type = 'string'
        self._length: int | None = None
        self._choices: list[str] = []

    def _make_goal(self, userdata: UserData) -> Any:
        return OperatorInput.Goal(prompt=self._message, type=self._type, choices=self._choices, asker=self.path)

    def _end(self, ended: GoalOutcome, userdata: UserData) -> str:
        userdata['data'] = None
        result = ended.result
        code = result.code if result is not None else OperatorInput.Result.UNKNOWN
        if ended.status is GoalStatus.SUCCEEDED and code == OperatorInput.Result.SUCCESS and result is not None:
            try:
                value = check_value(from_entry(result.value), self._type)
            except FlexbtError as error:
                return self._unusable(str(error))
            if self._length is not None and len(value) != self._length:
                return self._unusable(f'{self._length} numbers are needed, not {len(value)}')
            userdata['data'] = list(value) if self._length is not None else value
            return 'received'
        if code in (OperatorInput.Result.DECLINED, OperatorInput.Result.CANCELED):
            self.log_warn(f'no answer to {self._message!r}: {getattr(result, "message", "")}')
            return 'aborted'
        self.log_warn(f'nobody could be asked {self._message!r}: {ended.reason or getattr(result, "message", "")}')
        return 'no_connection'

    def _unusable(self, reason: str) -> str:
        self.log_warn(f'the answer to {self._message!r} cannot be used: {reason}')
        return 'data_error'


class InputState(_OperatorInputState):
    """
    Ask the operator for a value. Leaving the state withdraws the input request.

    -- request      uint8       0 int, 1 float, 2 to 4 that many floats, 10 Pose, 11 PoseStamped, 12 string
    -- message      string      Text of the input request
    -- timeout      float       No effect: a missing operator is detected after a second
    -- action_topic string      Name of the action of the executive that asks; None for the usual one

    #> data                     The answer; None without one.

    <= received                 The operator has answered.
    <= aborted                  The operator has declined to answer.
    <= no_connection            No operator could be asked.
    <= data_error               The answer has another type or length.
    """

    def __init__(self, request: int, message: str, timeout: float = 1.0, action_topic: str | None = None) -> None:
        super().__init__(message, (), action_topic)
        if request not in _TYPES:
            known = ', '.join(map(str, _TYPES))
            raise StateParameterError(self, 'request', f'{request!r} is none of {known} (for 13 use SelectionState)')
        self._type, self._length = _TYPES[request]


class SelectionState(_OperatorInputState):
    """
    Ask the operator to select one of several texts.

    -- message      string      Text of the input request
    -- timeout      float       No effect: a missing operator is detected after a second
    -- action_topic string      Name of the action of the executive that asks; None for the usual one

    ># items                    A list; the text of each item can be selected.
    #> data                     The selected text; None without one.

    <= received                 The operator has selected.
    <= aborted                  The operator has declined to select.
    <= no_connection            No operator could be asked.
    <= data_error               The list is empty, or the answer is not a text.
    """

    def __init__(self, message: str, timeout: float = 1.0, action_topic: str | None = None) -> None:
        super().__init__(message, ('items',), action_topic)

    def on_enter(self, userdata: UserData) -> None:
        self._choices = [str(item) for item in userdata['items']]
        if self._choices:
            super().on_enter(userdata)

    def execute(self, userdata: UserData) -> str | None:
        if not self._choices:
            userdata['data'] = None
            return self._unusable('there are no items to select from')
        return super().execute(userdata)
