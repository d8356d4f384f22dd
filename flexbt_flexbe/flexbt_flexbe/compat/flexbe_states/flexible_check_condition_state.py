# SPDX-License-Identifier: BSD-3-Clause
"""FlexBE's ``flexbe_states.flexible_check_condition_state``."""

from flexbt_flexbe.states import FlexibleCheckConditionState

__all__ = ['FlexibleCheckConditionState']
