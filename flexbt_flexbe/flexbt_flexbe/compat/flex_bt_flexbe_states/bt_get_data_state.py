# SPDX-License-Identifier: BSD-3-Clause
"""``flex_bt_flexbe_states.bt_get_data_state``."""

from flexbt_flexbe.states import BtGetDataState

__all__ = ['BtGetDataState']
