# SPDX-License-Identifier: BSD-3-Clause
"""FlexBE's ``flexbe_states.operator_decision_state``."""

from flexbt_flexbe.states import OperatorDecisionState

__all__ = ['OperatorDecisionState']
