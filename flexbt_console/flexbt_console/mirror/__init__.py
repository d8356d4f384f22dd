# SPDX-License-Identifier: BSD-3-Clause
"""The mirror of an executive: a plain model without ROS and without a user interface, which serves them all."""

from flexbt_console.mirror.command_tracker import CommandState, CommandTracker, TrackedCommand
from flexbt_console.mirror.freshness import Freshness, LinkState
from flexbt_console.mirror.mirror import Change, Mirror, Transit
from flexbt_console.mirror.view import View, choices

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
