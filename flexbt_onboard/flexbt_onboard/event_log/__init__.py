# SPDX-License-Identifier: BSD-3-Clause
"""Who did what and when on the robot: written, told to the operators, and evaluated."""

from .event_log import EVENT_LOG_FILES, EVENT_LOG_SIZE, EventLog, rotated
from .reporter import OperatorLog, Reporter, StorageProblems

__all__ = [
    'EVENT_LOG_FILES',
    'EVENT_LOG_SIZE',
    'EventLog',
    'OperatorLog',
    'Reporter',
    'StorageProblems',
    'rotated',
]
