# SPDX-License-Identifier: BSD-3-Clause
"""The hierarchical state machine: a pure core, without ROS.

Time is a clock object and waking up a callback, so that it runs in milliseconds and deterministically on a manual
clock. What a user needs is exported here.
"""

from .authoring.define import define
from .authoring.machine import ConcurrencyContainer, OperatableStateMachine, PriorityContainer
from .authoring.wrappers import StateWrapper, with_retry, with_timeout
from .authoring.yaml_form import read_machine
from .checks.data_flow import Race, Read, races, unsure_reads
from .engine.command_queue import Answer
from .engine.leaf import CallbackOnThread, LeafRun, callback_on
from .engine.observer import LoggingObserver, RunObserver
from .engine.region import HeldBack
from .engine.run import MAX_TRANSITIONS, MachineRun
from .model.autonomy import AUTONOMY_NAMES, Autonomy
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
    is_inside,
)
from .model.errors import MachineError, StateError, StateMachineError, UserDataError
from .model.event_state import DEFAULT_RATE, EXIT_TIMEOUT, EventState, ExitReason, called_state
from .model.machine import Child, Machine
from .model.state_host import Severity, StateHost
from .model.userdata import DefaultUserData, UserData
from .resume.position import Position
from .resume.restoring import position_of, reasons_against, start_at
from .resume.switching import switch_machine

__all__ = [
    'AUTONOMY_NAMES',
    'DEFAULT_RATE',
    'ERROR',
    'EXIT_TIMEOUT',
    'MAX_TRANSITIONS',
    'PREEMPTED',
    'ROOT_PATH',
    'Answer',
    'Autonomy',
    'CallbackOnThread',
    'Child',
    'ConcurrencyContainer',
    'Condition',
    'Decision',
    'DecisionKind',
    'DefaultUserData',
    'EventState',
    'ExitReason',
    'HeldBack',
    'LeafRun',
    'LoggingObserver',
    'Machine',
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
    'StateHost',
    'StateKind',
    'StateMachineError',
    'StateWrapper',
    'StructureEntry',
    'Transition',
    'UserData',
    'UserDataError',
    'callback_on',
    'called_state',
    'define',
    'is_inside',
    'position_of',
    'races',
    'read_machine',
    'reasons_against',
    'start_at',
    'switch_machine',
    'unsure_reads',
    'with_retry',
    'with_timeout',
]
