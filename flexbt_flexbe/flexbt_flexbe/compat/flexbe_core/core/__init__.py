# SPDX-License-Identifier: BSD-3-Clause
"""FlexBE's ``flexbe_core.core``."""

from flexbt_flexbe import (
    ConcurrencyContainer,
    EventState,
    OperatableStateMachine,
    PriorityContainer,
    UserData,
)

from .exceptions import StateError, StateMachineError, UserDataError
from .ros_state import RosState

__all__ = [
    'ConcurrencyContainer',
    'EventState',
    'OperatableStateMachine',
    'PriorityContainer',
    'RosState',
    'StateError',
    'StateMachineError',
    'UserData',
    'UserDataError',
]
