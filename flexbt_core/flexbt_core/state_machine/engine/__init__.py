# SPDX-License-Identifier: BSD-3-Clause
"""A run of a machine: regions, containers, leaves, commands."""

from .command_queue import Answer
from .container import ContainerRun
from .leaf import CallbackOnThread, LeafRun, callback_on
from .observer import LoggingObserver, RunObserver
from .region import HeldBack, Node, Region
from .run import MAX_TRANSITIONS, MachineRun

__all__ = [
    'MAX_TRANSITIONS',
    'Answer',
    'CallbackOnThread',
    'ContainerRun',
    'HeldBack',
    'LeafRun',
    'LoggingObserver',
    'MachineRun',
    'Node',
    'Region',
    'RunObserver',
    'callback_on',
]
