# SPDX-License-Identifier: BSD-3-Clause
"""FlexBE's ``flexbe_states.user_data_state``."""

from flexbt_flexbe.states import UserdataState

__all__ = ['UserdataState']
