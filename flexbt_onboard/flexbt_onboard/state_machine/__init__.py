# SPDX-License-Identifier: BSD-3-Clause
"""The hierarchical state machine: a pure core, without ROS.

Time is a clock object and waking up a callback, so that it runs in milliseconds and deterministically on a manual
clock. What a user needs is exported here.
"""

from .autonomy import Autonomy
from .command_queue import Answer
from .decision import Decision, DecisionKind
from .definition import (
    ERROR,
    PREEMPTED,
    ROOT_PATH,
    MachineDefinition,
    StateDefinition,
    StateKind,
    StructureEntry,
    Transition,
)
from .errors import MachineError, StateError, StateMachineError, UserDataError
from .event_state import EventState, ExitReason, Severity, called_state
from .machine import OperatableStateMachine, define
from .run import MachineRun, RunObserver
from .userdata import UserData

__all__ = [
    'ERROR',
    'PREEMPTED',
    'ROOT_PATH',
    'Answer',
    'Autonomy',
    'Decision',
    'DecisionKind',
    'EventState',
    'ExitReason',
    'MachineDefinition',
    'MachineError',
    'MachineRun',
    'OperatableStateMachine',
    'RunObserver',
    'Severity',
    'StateDefinition',
    'StateError',
    'StateKind',
    'StateMachineError',
    'StructureEntry',
    'Transition',
    'UserData',
    'UserDataError',
    'called_state',
    'define',
]
