# SPDX-License-Identifier: BSD-3-Clause
"""``flex_bt_flexbe_states.bt_loader_state``."""

from flexbt_flexbe.states import BtLoaderState

__all__ = ['BtLoaderState']
