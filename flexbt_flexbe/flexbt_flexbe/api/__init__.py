# SPDX-License-Identifier: BSD-3-Clause
"""``flexbe_core`` on FlexBT's engine: states, containers, behaviors, loggers."""

from .behavior import Behavior
from .containers import ConcurrencyContainer, OperatableStateMachine, PriorityContainer
from .event_state import EventState
from .logger import Logger
from .parameter_values import YAML_PREFIX, converted, from_yaml_file, is_yaml_file
from .ros_access import RosAccess
from .state_logger import StateLogger

__all__ = [
    'YAML_PREFIX',
    'Behavior',
    'ConcurrencyContainer',
    'EventState',
    'Logger',
    'OperatableStateMachine',
    'PriorityContainer',
    'RosAccess',
    'StateLogger',
    'converted',
    'from_yaml_file',
    'is_yaml_file',
]
