# SPDX-License-Identifier: BSD-3-Clause
"""FlexBE's states that compute a value, branch on one, write userdata, or log."""

from __future__ import annotations

import contextlib
import copy
import inspect
from collections.abc import Callable, Iterable, Sequence
from typing import Any

import flexbt_states
from flexbt_core.skills.skill import Outcome, OutcomeClass
from flexbt_core.state_machine.model.userdata import UserData
from flexbt_flexbe.api.event_state import EventState, RosAccess
from flexbt_flexbe.api.logger import Logger
from flexbt_states.errors import StateParameterError
from flexbt_states.parameter_checks import checked_callable, checked_outcomes


class CalculationState(RosAccess, flexbt_states.CalculationState):
    __doc__ = flexbt_states.CalculationState.__doc__


class FlexibleCalculationState(EventState):
    """
    Compute a value from several ones. If the function raises, the state has a fault.

    -- calculation  function    Function with a keyword for each of input_keys, or with one list of the values
    -- input_keys   string[]    Keys whose values the function gets

    ># KEY                      Each of input_keys.
    #> output_value             Result of the function.

    <= done                     The value was computed.
    """

    is_instant = True
    runs_while_blocked = False  # a value that is computed of itself, such as a count, is computed once

    def __init__(self, calculation: Callable[..., Any], input_keys: Sequence[str]) -> None:
        super().__init__(outcomes=['done'], input_keys=input_keys, output_keys=['output_value'], desired_rate=None)
        self._value_of = _of_keys(self, 'calculation', calculation, prefers_list=False)

    def execute(self, userdata: UserData) -> str:
        userdata['output_value'] = self._value_of(userdata)
        return 'done'


# FlexBE's states that branch on a value, or on several.


class CheckConditionState(RosAccess, flexbt_states.CheckConditionState):
    __doc__ = flexbt_states.CheckConditionState.__doc__


class FlexibleCheckConditionState(EventState):
    """
    Check a condition of several values. If the function raises, the state has a fault: neither true nor false.

    -- predicate    function    Function with one list of the values, or with a keyword for each of input_keys
    -- input_keys   string[]    Keys whose values the function gets

    ># KEY                      Each of input_keys.

    <= true                     The condition holds.
    <= false                    The condition does not hold.
    """

    is_instant = True

    def __init__(self, predicate: Callable[..., Any], input_keys: Sequence[str]) -> None:
        super().__init__(outcomes=['true', 'false'], input_keys=input_keys, desired_rate=None)
        self._value_of = _of_keys(self, 'predicate', predicate, prefers_list=True)

    def execute(self, userdata: UserData) -> str:
        return 'true' if self._value_of(userdata) else 'false'


class DecisionState(EventState):
    """
    Leave by the outcome that a function returns. While it returns None, it is called again, at the state's rate.

    -- outcomes     string[]    Possible outcomes
    -- conditions   function    Function of one value; returns an outcome, or None to wait

    ># input_value              Argument of the function.

    <= OUTCOME                  Each of outcomes: the function returned it. Another name is a fault of the state.
    """

    def __init__(self, outcomes: Iterable[str], conditions: Callable[[Any], str | None]) -> None:
        names = checked_outcomes(self, 'outcomes', outcomes)
        super().__init__(outcomes=names, input_keys=['input_value'])
        self.skill = self.skill.completed_by('', {name: Outcome(OutcomeClass.ANSWERED) for name in names})
        self._conditions = checked_callable(self, 'conditions', conditions)

    def execute(self, userdata: UserData) -> str | None:
        outcome = self._conditions(userdata['input_value'])
        return None if outcome is None else str(outcome)


# FlexBE's state that writes a value to userdata.


class UserdataState(EventState):
    """
    Write a value to userdata.

    -- data         object      The value

    #> data                     A copy of the value; the value itself if it cannot be copied.

    <= done                     The value was written.
    """

    is_instant = True
    runs_while_blocked = False  # it would overwrite what others write meanwhile

    def __init__(self, data: Any) -> None:
        super().__init__(outcomes=['done'], output_keys=['data'], desired_rate=None)
        self._data = data

    def execute(self, userdata: UserData) -> str:
        value = self._data
        with contextlib.suppress(Exception):  # code of the value
            value = copy.deepcopy(value)
        userdata['data'] = value
        return 'done'


# FlexBE's states that log a text or a value for the operator.


class LogState(EventState):
    """
    Log a value as text for the operator.

    -- text         object      Value to log; shown as text
    -- severity     uint8       Logger.REPORT_DEBUG, _INFO, _HINT, _WARN or _ERROR

    <= done                     The line was logged.
    """

    is_instant = True

    def __init__(self, text: object, severity: int = Logger.REPORT_HINT) -> None:
        super().__init__(outcomes=['done'], desired_rate=None)
        self._text = text
        self._severity = severity

    def on_enter(self, userdata: UserData) -> None:
        Logger.log(self._text, self._severity)

    def execute(self, userdata: UserData) -> str:
        return 'done'


class LogKeyState(EventState):
    """
    Log a value with a text for the operator.

    -- text         string      Text with {} in place of the value, as in str.format
    -- severity     uint8       Logger.REPORT_DEBUG, _INFO, _HINT, _WARN or _ERROR

    ># data                     The value.

    <= done                     The line was logged.
    """

    is_instant = True

    def __init__(self, text: str, severity: int = Logger.REPORT_HINT) -> None:
        super().__init__(outcomes=['done'], input_keys=['data'], desired_rate=None)
        self._text = text
        self._severity = severity

    def on_enter(self, userdata: UserData) -> None:
        Logger.log(self._text.format(userdata['data']), self._severity)

    def execute(self, userdata: UserData) -> str:
        return 'done'


# The two ways in which FlexBE's flexible states pass several values to a function.
#
# FlexBE's documentation says "a list" for both states, but its code passes keywords in one and a list in the other.
# Here the parameters of the function decide, so that both forms work; the state defines which form it prefers.


def _of_keys(
    state: EventState, parameter: str, function: Callable[..., Any], *, prefers_list: bool
) -> Callable[[UserData], Any]:
    """Return a function of the userdata that calls ``function`` with the values of the input keys.

    Raises:
        StateParameterError: ``function`` accepts neither form.
    """
    checked_callable(state, parameter, function)
    keys = state.input_keys
    takes_list, takes_keywords = _binds(function, []), _binds(function, **dict.fromkeys(keys))
    if not takes_list and not takes_keywords:
        raise StateParameterError(state, parameter, f'takes neither one list nor the keywords {", ".join(keys)}')
    if takes_list and (prefers_list or not takes_keywords):
        return lambda userdata: function([userdata[key] for key in keys])
    return lambda userdata: function(**{key: userdata[key] for key in keys})


def _binds(function: Callable[..., Any], *args: Any, **keywords: Any) -> bool:
    try:
        inspect.signature(function).bind(*args, **keywords)
    except TypeError:
        return False
    except ValueError:  # a builtin without a signature: those in use take one list
        return not keywords
    return True
