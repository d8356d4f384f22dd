# SPDX-License-Identifier: BSD-3-Clause
"""FlexBE's generic states, and the states for behavior trees under FlexBE's interface."""

from flexbt_flexbe.states.bt_states import (
    BtExecuteGoalState,
    BtExecuteState,
    BtGetDataState,
    BtLoaderState,
    BtSetDataState,
)
from flexbt_flexbe.states.calculation_state import CalculationState
from flexbt_flexbe.states.check_condition_state import CheckConditionState
from flexbt_flexbe.states.decision_state import DecisionState
from flexbt_flexbe.states.flexible_calculation_state import FlexibleCalculationState
from flexbt_flexbe.states.flexible_check_condition_state import FlexibleCheckConditionState
from flexbt_flexbe.states.input_state import InputState, SelectionState
from flexbt_flexbe.states.log_key_state import LogKeyState
from flexbt_flexbe.states.log_state import LogState
from flexbt_flexbe.states.operator_decision_state import OperatorDecisionState
from flexbt_flexbe.states.publisher_states import PublisherBoolState, PublisherEmptyState, PublisherStringState
from flexbt_flexbe.states.subscriber_state import SubscriberState
from flexbt_flexbe.states.user_data_state import UserDataState
from flexbt_flexbe.states.wait_state import WaitState

__all__ = [
    'BtExecuteGoalState',
    'BtExecuteState',
    'BtGetDataState',
    'BtLoaderState',
    'BtSetDataState',
    'CalculationState',
    'CheckConditionState',
    'DecisionState',
    'FlexibleCalculationState',
    'FlexibleCheckConditionState',
    'InputState',
    'LogKeyState',
    'LogState',
    'OperatorDecisionState',
    'PublisherBoolState',
    'PublisherEmptyState',
    'PublisherStringState',
    'SelectionState',
    'SubscriberState',
    'UserDataState',
    'WaitState',
]
