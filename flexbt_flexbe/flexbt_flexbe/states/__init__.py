# SPDX-License-Identifier: BSD-3-Clause
"""FlexBE's generic states, and the states for behavior trees under FlexBE's interface."""

from .bt_states import BtExecuteGoalState, BtExecuteState, BtGetDataState, BtLoaderState, BtSetDataState
from .calculation_states import CalculationState, FlexibleCalculationState
from .condition_states import CheckConditionState, DecisionState, FlexibleCheckConditionState
from .log_states import LogKeyState, LogState
from .operator_states import InputState, OperatorDecisionState, SelectionState
from .publisher_states import PublisherBoolState, PublisherEmptyState, PublisherStringState
from .subscriber_state import SubscriberState
from .user_data_state import UserdataState
from .wait_states import WaitForServersState, WaitState

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
