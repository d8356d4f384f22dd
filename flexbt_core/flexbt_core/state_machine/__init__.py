# SPDX-License-Identifier: BSD-3-Clause
"""The hierarchical state machine: a pure core, without ROS.

Time is a clock object and waking up a callback, so that it runs in milliseconds and deterministically on a manual
clock. What a user needs is exported here.
"""

from .authoring.machine import Child, ConcurrencyContainer, OperatableStateMachine, PriorityContainer, define
from .authoring.wrappers import StateWrapper, innermost, with_retry, with_timeout
from .checks.data_flow import Race, Read, races, unsure_reads
from .engine.command_queue import Answer
from .engine.observer import RunObserver
from .engine.run import MachineRun
from .model.autonomy import Autonomy
from .model.decision import Decision, DecisionKind
from .model.definition import (
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
from .model.errors import MachineError, StateError, StateMachineError, UserDataError
from .model.event_state import EventState, ExitReason, Severity, called_state
from .model.userdata import UserData
from .resume.position import Position

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
