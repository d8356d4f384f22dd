# SPDX-License-Identifier: BSD-3-Clause
"""States for FlexBT behaviors: behavior trees, operator input and generic ones."""

from .bt_execute_goal_state import BtExecuteGoalState
from .bt_execute_state import BtExecuteState
from .bt_get_data_state import BtGetDataState
from .bt_loader_state import BtLoaderState
from .bt_set_data_state import BtSetDataState
from .calculation_state import CalculationState
from .check_condition_state import CheckConditionState
from .execute_behavior_state import ExecuteBehaviorState
from .log_key_state import LogKeyState
from .log_state import LogState
from .operator_decision_state import OperatorDecisionState
from .operator_input_state import OperatorInputState
from .publish_once_state import PublishOnceState
from .subscribe_once_state import SubscribeOnceState
from .subscriber_state import SubscriberState
from .wait_state import WaitState

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
