# SPDX-License-Identifier: BSD-3-Clause
"""FlexBE's ``flexbe_states.calculation_state``."""

from flexbt_flexbe.states import CalculationState

__all__ = ['CalculationState']
