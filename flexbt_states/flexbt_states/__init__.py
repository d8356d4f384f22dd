# SPDX-License-Identifier: BSD-3-Clause
"""States for FlexBT behaviors: behavior trees, operator input and generic ones."""

from flexbt_states.bt_execute_goal_state import BtExecuteGoalState
from flexbt_states.bt_execute_state import BtExecuteState
from flexbt_states.bt_get_data_state import BtGetDataState
from flexbt_states.bt_loader_state import BtLoaderState
from flexbt_states.bt_set_data_state import BtSetDataState
from flexbt_states.calculation_state import CalculationState
from flexbt_states.check_condition_state import CheckConditionState
from flexbt_states.execute_behavior_state import ExecuteBehaviorState
from flexbt_states.log_key_state import LogKeyState
from flexbt_states.log_state import LogState
from flexbt_states.operator_decision_state import OperatorDecisionState
from flexbt_states.operator_input_state import OperatorInputState
from flexbt_states.publish_once_state import PublishOnceState
from flexbt_states.subscribe_once_state import SubscribeOnceState
from flexbt_states.subscriber_state import SubscriberState
from flexbt_states.wait_state import WaitState

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
    'WaitState',
]
