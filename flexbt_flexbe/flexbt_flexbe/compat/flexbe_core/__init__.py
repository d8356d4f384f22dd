# SPDX-License-Identifier: BSD-3-Clause
"""FlexBE's ``flexbe_core``, on FlexBT's engine."""

from flexbt_flexbe import (
    Autonomy,
    Behavior,
    ConcurrencyContainer,
    EventState,
    Logger,
    OperatableStateMachine,
    PriorityContainer,
    StateLogger,
    UserData,
    initialize_flexbe_core,
    set_node,
)

__all__ = [
    'Autonomy',
    'Behavior',
    'ConcurrencyContainer',
    'EventState',
    'Logger',
    'OperatableStateMachine',
    'PriorityContainer',
    'StateLogger',
    'UserData',
    'initialize_flexbe_core',
    'set_node',
]
