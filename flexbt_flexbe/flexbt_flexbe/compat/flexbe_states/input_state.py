# SPDX-License-Identifier: BSD-3-Clause
"""FlexBE's ``flexbe_states.input_state``."""

from flexbt_flexbe.states import InputState

__all__ = ['InputState']
