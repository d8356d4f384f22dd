# SPDX-License-Identifier: BSD-3-Clause
"""``flex_bt_flexbe_states.bt_set_data_state``."""

from flexbt_flexbe.states import BtSetDataState

__all__ = ['BtSetDataState']
