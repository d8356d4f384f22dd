# SPDX-License-Identifier: BSD-3-Clause
"""States and what they see of their run, outcomes, userdata, autonomy; machines as written, and once checked."""

from .autonomy import AUTONOMY_NAMES, UNDECLARED, Autonomy, is_autonomous
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
    are_apart,
    child_path,
    is_inside,
)
from .errors import MachineError, StateError, StateMachineError, UserDataError
from .event_state import DEFAULT_RATE, EXIT_TIMEOUT, EventState, ExitReason, called_state, set_called_state
from .machine import Child, Machine
from .progress import Progress
from .state_clock import StateClock
from .state_host import Severity, StateHost
from .state_skill import state_skill
from .userdata import DefaultUserData, Scope, UserData

__all__ = [
    'AUTONOMY_NAMES',
    'DEFAULT_RATE',
    'ERROR',
    'EXIT_TIMEOUT',
    'PREEMPTED',
    'ROOT_PATH',
    'UNDECLARED',
    'Autonomy',
    'Child',
    'Condition',
    'Decision',
    'DecisionKind',
    'DefaultUserData',
    'EventState',
    'ExitReason',
    'Machine',
    'MachineDefinition',
    'MachineError',
    'Progress',
    'Scope',
    'Severity',
    'StateClock',
    'StateDefinition',
    'StateError',
    'StateHost',
    'StateKind',
    'StateMachineError',
    'StructureEntry',
    'Transition',
    'UserData',
    'UserDataError',
    'are_apart',
    'called_state',
    'child_path',
    'is_autonomous',
    'is_inside',
    'set_called_state',
    'state_skill',
]
