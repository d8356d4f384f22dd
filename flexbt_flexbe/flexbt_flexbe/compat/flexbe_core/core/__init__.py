# SPDX-License-Identifier: BSD-3-Clause
"""FlexBE's ``flexbe_core.core``."""

from flexbt_flexbe import (
    ConcurrencyContainer,
    EventState,
    OperatableStateMachine,
    PriorityContainer,
    UserData,
)

__all__ = ['ConcurrencyContainer', 'EventState', 'OperatableStateMachine', 'PriorityContainer', 'UserData']
