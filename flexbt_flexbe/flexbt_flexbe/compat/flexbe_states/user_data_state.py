# SPDX-License-Identifier: BSD-3-Clause
"""FlexBE's ``flexbe_states.user_data_state``."""

from flexbt_flexbe.states import UserDataState

__all__ = ['UserDataState']
