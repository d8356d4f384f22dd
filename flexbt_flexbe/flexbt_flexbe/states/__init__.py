# SPDX-License-Identifier: BSD-3-Clause
"""FlexBE's generic states, and the states for behavior trees under FlexBE's interface."""

from .bt_states import BtExecuteGoalState, BtExecuteState, BtGetDataState, BtLoaderState, BtSetDataState
from .calculation_state import CalculationState
from .check_condition_state import CheckConditionState
from .decision_state import DecisionState
from .flexible_calculation_state import FlexibleCalculationState
from .flexible_check_condition_state import FlexibleCheckConditionState
from .input_state import InputState, SelectionState
from .log_key_state import LogKeyState
from .log_state import LogState
from .operator_decision_state import OperatorDecisionState
from .publisher_states import PublisherBoolState, PublisherEmptyState, PublisherStringState
from .subscriber_state import SubscriberState
from .user_data_state import UserdataState
from .wait_for_servers_state import WaitForServersState
from .wait_state import WaitState

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
    'UserdataState',
    'WaitForServersState',
    'WaitState',
]
