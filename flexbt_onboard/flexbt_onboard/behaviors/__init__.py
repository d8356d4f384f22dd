# SPDX-License-Identifier: BSD-3-Clause
"""What an installed behavior is, how one is built, and what its states get from their host."""

from .behavior import (
    Behavior,
    BehaviorInput,
    BehaviorManifest,
    BehaviorParameter,
    OperatorGone,
    ParameterValue,
    parameter_text,
)
from .behavior_library import BehaviorEntry, BehaviorLibrary, described
from .machine_behavior import MachineBehavior, machine_entry, state_modules, states_of
from .offline_building import building
from .run_building import (
    RunRequest,
    build,
    checked_autonomy,
    checked_inputs,
    definition_of,
    run_request,
    structure_message,
)
from .run_context import RunContext, current_run
from .run_goals import RunGoals
from .run_services import READY_SECONDS, StateServices, state_services

__all__ = [
    'READY_SECONDS',
    'Behavior',
    'BehaviorEntry',
    'BehaviorInput',
    'BehaviorLibrary',
    'BehaviorManifest',
    'BehaviorParameter',
    'MachineBehavior',
    'OperatorGone',
    'ParameterValue',
    'RunContext',
    'RunGoals',
    'RunRequest',
    'StateServices',
    'build',
    'building',
    'checked_autonomy',
    'checked_inputs',
    'current_run',
    'definition_of',
    'described',
    'machine_entry',
    'parameter_text',
    'run_request',
    'state_modules',
    'state_services',
    'states_of',
    'structure_message',
]
