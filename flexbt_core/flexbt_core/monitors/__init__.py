# SPDX-License-Identifier: BSD-3-Clause
"""Monitors: what holds for every mission, and what its engineer requires, watched while it happens.

One definition for all: a proof has them beside the engines in each of its steps, a test in its runs, a robot in its
own. Each remembers a few bits, and takes next to no time for an event. ::

    monitor = MachineMonitor(resources, found=lambda violation: print(violation.text))
    run = MachineRun(define(machine), clock, monitor=monitor)
"""

from .machine_monitor import MachineMonitor, Resources, declared_resources
from .properties import Property, Violation, shared_actuators
from .requirements import (
    PROVED_ONLY,
    After,
    Apart,
    AtMost,
    Before,
    Never,
    Possible,
    Requirement,
    Requirements,
    While,
    Within,
    Written,
    violation_of,
)
from .tree_monitor import TreeMonitor

__all__ = [
    'PROVED_ONLY',
    'After',
    'Apart',
    'AtMost',
    'Before',
    'MachineMonitor',
    'Never',
    'Possible',
    'Property',
    'Requirement',
    'Requirements',
    'Resources',
    'TreeMonitor',
    'Violation',
    'While',
    'Within',
    'Written',
    'declared_resources',
    'shared_actuators',
    'violation_of',
]
