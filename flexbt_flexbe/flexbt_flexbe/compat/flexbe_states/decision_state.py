# SPDX-License-Identifier: BSD-3-Clause
"""FlexBE's ``flexbe_states.decision_state``."""

from flexbt_flexbe.states import DecisionState

__all__ = ['DecisionState']
