# SPDX-License-Identifier: BSD-3-Clause
"""FlexBE's ``flexbe_core.core.exceptions``."""

from flexbt_core.state_machine import StateError, StateMachineError, UserDataError

__all__ = ['StateError', 'StateMachineError', 'UserDataError']
