# SPDX-License-Identifier: BSD-3-Clause
"""FlexBE's ``flexbe_core.core.operatable_state_machine``."""

from flexbt_flexbe import OperatableStateMachine

__all__ = ['OperatableStateMachine']
