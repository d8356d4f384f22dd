# SPDX-License-Identifier: BSD-3-Clause
"""A run of a machine: regions, containers, leaves, commands."""

from .calling import Calling
from .command_queue import Answer
from .container import ContainerRun
from .halt_wait import HaltWait
from .leaf import LeafRun
from .monitor import MonitoredRun, MonitoredState, RunMonitor
from .observer import LoggingObserver, RunObserver
from .region import HeldBack, Node, Region
from .run import MAX_TRANSITIONS, STOP_TIMEOUT, MachineRun

__all__ = [
    'MAX_TRANSITIONS',
    'STOP_TIMEOUT',
    'Answer',
    'Calling',
    'ContainerRun',
    'HaltWait',
    'HeldBack',
    'LeafRun',
    'LoggingObserver',
    'MachineRun',
    'MonitoredRun',
    'MonitoredState',
    'Node',
    'Region',
    'RunMonitor',
    'RunObserver',
]
