# SPDX-License-Identifier: BSD-3-Clause
"""``flex_bt_flexbe_states.bt_execute_state``."""

from flexbt_flexbe.states import BtExecuteState

__all__ = ['BtExecuteState']
