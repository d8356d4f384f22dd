# SPDX-License-Identifier: BSD-3-Clause
"""FlexBE's ``flexbe_states.wait_state``."""

from flexbt_flexbe.states import WaitState

__all__ = ['WaitState']
