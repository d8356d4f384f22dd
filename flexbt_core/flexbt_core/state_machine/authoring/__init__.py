# SPDX-License-Identifier: BSD-3-Clause
"""How machines are written: in Python as in FlexBE, or typed; in YAML; with time-outs and further attempts."""

from .checked_definition import define
from .machine import ConcurrencyContainer, OperatableStateMachine, PriorityContainer
from .wrappers import StateWrapper, with_retry, with_timeout
from .yaml_form import read_machine

__all__ = [
    'ConcurrencyContainer',
    'OperatableStateMachine',
    'PriorityContainer',
    'StateWrapper',
    'define',
    'read_machine',
    'with_retry',
    'with_timeout',
]
