# SPDX-License-Identifier: BSD-3-Clause
"""FlexBE's ``flexbe_core.core``."""

from flexbt_flexbe import EventState, OperatableStateMachine, UserData

__all__ = ['EventState', 'OperatableStateMachine', 'UserData']
