# SPDX-License-Identifier: BSD-3-Clause
"""FlexBE's ``flexbe_states.selection_state``."""

from flexbt_flexbe.states import SelectionState

__all__ = ['SelectionState']
