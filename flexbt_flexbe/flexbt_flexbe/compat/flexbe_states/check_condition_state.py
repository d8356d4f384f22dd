# SPDX-License-Identifier: BSD-3-Clause
"""FlexBE's ``flexbe_states.check_condition_state``."""

from flexbt_flexbe.states import CheckConditionState

__all__ = ['CheckConditionState']
