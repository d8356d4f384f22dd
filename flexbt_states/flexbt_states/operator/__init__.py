# SPDX-License-Identifier: BSD-3-Clause
"""States that ask the operator: for a decision, or for a typed value."""

from .operator_decision_state import OperatorDecisionState
from .operator_input_state import OperatorInputState

__all__ = ['OperatorDecisionState', 'OperatorInputState']
