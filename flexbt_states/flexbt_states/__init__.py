# SPDX-License-Identifier: BSD-3-Clause
"""States for FlexBT behaviors: behavior trees, operator input and generic ones."""

from .behavior_trees import BtExecuteGoalState, BtExecuteState, BtGetDataState, BtLoaderState, BtSetDataState
from .generic import (
    CalculationState,
    CheckConditionState,
    ExecuteBehaviorState,
    LogKeyState,
    LogState,
    OperatorDecisionState,
    OperatorInputState,
    WaitForServersState,
    WaitState,
)
from .topics import PublishOnceState, SubscribeOnceState, SubscriberState

BtLoadState = BtLoaderState

__all__ = [
    'BtExecuteGoalState',
    'BtExecuteState',
    'BtGetDataState',
    'BtLoadState',
    'BtLoaderState',
    'BtSetDataState',
    'CalculationState',
    'CheckConditionState',
    'ExecuteBehaviorState',
    'LogKeyState',
    'LogState',
    'OperatorDecisionState',
    'OperatorInputState',
    'PublishOnceState',
    'SubscribeOnceState',
    'SubscriberState',
    'WaitForServersState',
    'WaitState',
]
