# SPDX-License-Identifier: BSD-3-Clause
"""FlexBE's ``flexbe_states.log_state``."""

from flexbt_flexbe.states import LogState

__all__ = ['LogState']
