# SPDX-License-Identifier: BSD-3-Clause
"""FlexBE's generic states, and the states for behavior trees under FlexBE's interface."""

from .bt_states import (
    BtExecuteGoalState,
    BtExecuteState,
    BtGetDataState,
    BtLoaderState,
    BtSetDataState,
    WaitForServersState,
    WaitState,
)
from .operator_states import InputState, OperatorDecisionState, SelectionState
from .topic_states import PublisherBoolState, PublisherEmptyState, PublisherStringState, SubscriberState
from .value_states import (
    CalculationState,
    CheckConditionState,
    DecisionState,
    FlexibleCalculationState,
    FlexibleCheckConditionState,
    LogKeyState,
    LogState,
    UserdataState,
)

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
