# SPDX-License-Identifier: BSD-3-Clause
"""What states are written with: action goals, their results, checks of parameters."""

from .goal_call import GoalCall, GoalState
from .goal_result import read_values, state_outcome
from .parameter_checks import (
    checked_action_type,
    checked_callable,
    checked_file,
    checked_keys,
    checked_message_type,
    checked_outcomes,
    checked_timeout,
    checked_topic,
    checked_tree,
    checked_type,
    checked_types,
)

__all__ = [
    'GoalCall',
    'GoalState',
    'checked_action_type',
    'checked_callable',
    'checked_file',
    'checked_keys',
    'checked_message_type',
    'checked_outcomes',
    'checked_timeout',
    'checked_topic',
    'checked_tree',
    'checked_type',
    'checked_types',
    'read_values',
    'state_outcome',
]
