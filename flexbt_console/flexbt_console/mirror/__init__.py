# SPDX-License-Identifier: BSD-3-Clause
"""The mirror of an executive: a plain model without ROS and without a user interface, which serves them all."""

from .command_tracker import CommandState, CommandTracker, TrackedCommand
from .freshness import Freshness, LinkState
from .mirror import Change, Mirror, Transit
from .view import View, choices

__all__ = [
    'Change',
    'CommandState',
    'CommandTracker',
    'Freshness',
    'LinkState',
    'Mirror',
    'TrackedCommand',
    'Transit',
    'View',
    'choices',
]
