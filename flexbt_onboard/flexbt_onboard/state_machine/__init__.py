# SPDX-License-Identifier: BSD-3-Clause
"""The hierarchical state machine: a pure core, without ROS.

Time is a clock object and waking up a callback, so that it runs in milliseconds and deterministically on a manual
clock. What a user needs is exported here.
"""

from .autonomy import Autonomy
from .command_queue import Answer
from .data_flow import Race, Read, races, unsure_reads
from .decision import Decision, DecisionKind
from .definition import (
    ERROR,
    PREEMPTED,
    ROOT_PATH,
    Condition,
    MachineDefinition,
    StateDefinition,
    StateKind,
    StructureEntry,
    Transition,
)
from .errors import MachineError, StateError, StateMachineError, UserDataError
from .event_state import EventState, ExitReason, Severity, called_state
from .machine import Child, ConcurrencyContainer, OperatableStateMachine, PriorityContainer, define
from .observer import RunObserver
from .position import Position
from .run import MachineRun
from .userdata import UserData
from .wrappers import StateWrapper, innermost, with_retry, with_timeout

__all__ = [
    'ERROR',
    'PREEMPTED',
    'ROOT_PATH',
    'Answer',
    'Autonomy',
    'Child',
    'ConcurrencyContainer',
    'Condition',
    'Decision',
    'DecisionKind',
    'EventState',
    'ExitReason',
    'MachineDefinition',
    'MachineError',
    'MachineRun',
    'OperatableStateMachine',
    'Position',
    'PriorityContainer',
    'Race',
    'Read',
    'RunObserver',
    'Severity',
    'StateDefinition',
    'StateError',
    'StateKind',
    'StateMachineError',
    'StateWrapper',
    'StructureEntry',
    'Transition',
    'UserData',
    'UserDataError',
    'called_state',
    'define',
    'innermost',
    'races',
    'unsure_reads',
    'with_retry',
    'with_timeout',
]
