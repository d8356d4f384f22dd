# SPDX-License-Identifier: BSD-3-Clause
"""FlexBE's ``flexbe_states.log_key_state``."""

from flexbt_flexbe.states import LogKeyState

__all__ = ['LogKeyState']
