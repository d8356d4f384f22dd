# SPDX-License-Identifier: BSD-3-Clause
"""States that compute, check, log, wait, ask the operator, or run a behavior of another executive."""

from .calculation_state import CalculationState
from .check_condition_state import CheckConditionState
from .execute_behavior_state import ExecuteBehaviorState
from .log_key_state import LogKeyState
from .log_state import LogState
from .operator_decision_state import OperatorDecisionState
from .operator_input_state import OperatorInputState
from .wait_for_servers_state import WaitForServersState
from .wait_state import WaitState

__all__ = [
    'CalculationState',
    'CheckConditionState',
    'ExecuteBehaviorState',
    'LogKeyState',
    'LogState',
    'OperatorDecisionState',
    'OperatorInputState',
    'WaitForServersState',
    'WaitState',
]
