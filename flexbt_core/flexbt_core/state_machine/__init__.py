# SPDX-License-Identifier: BSD-3-Clause
"""The hierarchical state machine: a pure core, without ROS.

Time is a clock object and waking up a callback, so that it runs in milliseconds and deterministically on a manual
clock. What a user needs is exported here. ::

    machine = OperatableStateMachine(outcomes=['finished'])
    with machine:
        OperatableStateMachine.add('Wait', WaitState(2.0), transitions={'done': 'finished'})
    run = MachineRun(define(machine), clock, observer, on_wake=wake_event.set)
    run.start()
    while run.step():
        wake_event.wait(clock, run.next_wake)
"""

from .authoring import (
    ConcurrencyContainer,
    OperatableStateMachine,
    PriorityContainer,
    StateWrapper,
    define,
    read_machine,
    with_retry,
    with_timeout,
)
from .checks import (
    Race,
    Read,
    races,
    unsure_reads,
)
from .engine import (
    MAX_TRANSITIONS,
    STOP_TIMEOUT,
    Answer,
    Calling,
    HeldBack,
    LeafRun,
    LoggingObserver,
    MachineRun,
    RunObserver,
)
from .model import (
    AUTONOMY_NAMES,
    DEFAULT_RATE,
    ERROR,
    EXIT_TIMEOUT,
    PREEMPTED,
    ROOT_PATH,
    Autonomy,
    Child,
    Condition,
    Decision,
    DecisionKind,
    DefaultUserData,
    EventState,
    ExitReason,
    Machine,
    MachineDefinition,
    MachineError,
    Progress,
    Severity,
    StateDefinition,
    StateError,
    StateHost,
    StateKind,
    StateMachineError,
    StructureEntry,
    Transition,
    UserData,
    UserDataError,
    called_state,
    is_inside,
    state_skill,
)
from .resume import (
    Position,
    position_of,
    reasons_against,
    start_at,
    switch_machine,
)

__all__ = [
    'AUTONOMY_NAMES',
    'DEFAULT_RATE',
    'ERROR',
    'EXIT_TIMEOUT',
    'MAX_TRANSITIONS',
    'PREEMPTED',
    'ROOT_PATH',
    'STOP_TIMEOUT',
    'Answer',
    'Autonomy',
    'Calling',
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
    'Progress',
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
    'called_state',
    'define',
    'is_inside',
    'position_of',
    'races',
    'read_machine',
    'reasons_against',
    'start_at',
    'state_skill',
    'switch_machine',
    'unsure_reads',
    'with_retry',
    'with_timeout',
]
