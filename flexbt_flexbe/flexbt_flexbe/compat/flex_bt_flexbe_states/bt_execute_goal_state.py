# SPDX-License-Identifier: BSD-3-Clause
"""``flex_bt_flexbe_states.bt_execute_goal_state``."""

from flexbt_flexbe.states import BtExecuteGoalState

__all__ = ['BtExecuteGoalState']
