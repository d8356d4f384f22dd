# SPDX-License-Identifier: BSD-3-Clause
"""States for FlexBT behaviors: behavior trees, operator input and generic ones."""

from .bt_data_states import BtGetDataState, BtLoaderState, BtSetDataState
from .bt_execute_states import BtExecuteGoalState, BtExecuteState
from .call_states import CallActionState, CallServiceState, CheckTopicState, PublishState, ReadTopicState
from .execute_behavior_state import ExecuteBehaviorState
from .operator_states import OperatorDecisionState, OperatorInputState
from .topic_states import PublishOnceState, SubscribeOnceState, SubscriberState
from .value_states import CalculationState, CheckConditionState, LogKeyState, LogState
from .wait_states import WaitForServersState, WaitState

BtLoadState = BtLoaderState

__all__ = [
    'BtExecuteGoalState',
    'BtExecuteState',
    'BtGetDataState',
    'BtLoadState',
    'BtLoaderState',
    'BtSetDataState',
    'CalculationState',
    'CallActionState',
    'CallServiceState',
    'CheckConditionState',
    'CheckTopicState',
    'ExecuteBehaviorState',
    'LogKeyState',
    'LogState',
    'OperatorDecisionState',
    'OperatorInputState',
    'PublishOnceState',
    'PublishState',
    'ReadTopicState',
    'SubscribeOnceState',
    'SubscriberState',
    'WaitForServersState',
    'WaitState',
]
