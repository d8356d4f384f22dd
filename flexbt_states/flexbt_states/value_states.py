# SPDX-License-Identifier: BSD-3-Clause
"""States that compute a value, branch on a condition, or log a text or a value."""

from __future__ import annotations

from collections.abc import Callable
from string import Formatter
from typing import Any

from flexbt_core.state_machine.model.event_state import EventState
from flexbt_core.state_machine.model.state_host import Severity
from flexbt_core.state_machine.model.userdata import UserData

from .errors import StateParameterError
from .parameter_checks import checked_callable, checked_text


class CalculationState(EventState):
    """
    Compute a value from another one. If the function raises, the state has a fault.

    -- calculation  function    Function of one value

    ># input_value              Argument of the function.
    #> output_value             Result of the function.

    <= done                     The value was computed.
    """

    is_instant = True

    def __init__(self, calculation: Callable[[Any], Any]) -> None:
        super().__init__(outcomes=['done'], input_keys=['input_value'], output_keys=['output_value'], desired_rate=None)
        self._calculation = checked_callable(self, 'calculation', calculation)

    def execute(self, userdata: UserData) -> str:
        userdata['output_value'] = self._calculation(userdata['input_value'])
        return 'done'


# State that branches on a condition.


class CheckConditionState(EventState):
    """
    Check a condition. If the function raises, the state has a fault: the result is neither true nor false.

    -- predicate    function    Function of one value; its result counts as true or false

    ># input_value              Argument of the function.

    <= true                     The condition holds.
    <= false                    The condition does not hold.
    """

    is_instant = True

    def __init__(self, predicate: Callable[[Any], Any]) -> None:
        super().__init__(outcomes=['true', 'false'], input_keys=['input_value'], desired_rate=None)
        self._predicate = checked_callable(self, 'predicate', predicate)

    def execute(self, userdata: UserData) -> str:
        return 'true' if self._predicate(userdata['input_value']) else 'false'


# State that logs a line for the operator.


class LogState(EventState):
    """
    Log a line for the operator.

    -- text         string      The line
    -- severity     Severity    Severity of the line

    <= done                     The line was logged.
    """

    is_instant = True

    def __init__(self, text: str, severity: Severity = Severity.INFO) -> None:
        super().__init__(outcomes=['done'], desired_rate=None)
        self._text = checked_text(self, 'text', text)
        self._severity = Severity(severity)

    def on_enter(self, userdata: UserData) -> None:
        self.log(self._severity, self._text)

    def execute(self, userdata: UserData) -> str:
        return 'done'


# State that logs a value for the operator.


class LogKeyState(EventState):
    """
    Log a value of the userdata for the operator.

    -- text         string      The line, with one {} in place of the value
    -- severity     Severity    Severity of the line

    ># data                     The value.

    <= done                     The line was logged.
    """

    is_instant = True

    def __init__(self, text: str, severity: Severity = Severity.INFO) -> None:
        super().__init__(outcomes=['done'], input_keys=['data'], desired_rate=None)
        try:
            fields = [
                field for _, field, _, _ in Formatter().parse(checked_text(self, 'text', text)) if field is not None
            ]
        except ValueError as error:
            raise StateParameterError(self, 'text', f'{text!r}: {error}') from None
        if fields not in ([''], ['0']):
            raise StateParameterError(self, 'text', f'{text!r} must have one {{}} for the value')
        self._text = text
        self._severity = Severity(severity)

    def on_enter(self, userdata: UserData) -> None:
        self.log(self._severity, self._text.format(userdata['data']))

    def execute(self, userdata: UserData) -> str:
        return 'done'
