# SPDX-License-Identifier: BSD-3-Clause
"""FlexBE's ``flexbe_states.flexible_calculation_state``."""

from flexbt_flexbe.states import FlexibleCalculationState

__all__ = ['FlexibleCalculationState']
