# SPDX-License-Identifier: BSD-3-Clause
"""Monitors: what holds for every mission, and what its engineer requires, watched while it happens.

One definition for all: a proof has them beside the engines in each of its steps, a test in its runs, a robot in its
own. Each remembers a few bits, and takes next to no time for an event. ::

    monitor = MachineMonitor(resources, found=lambda violation: print(violation.text))
    run = MachineRun(define(machine), clock, monitor=monitor)
"""

from .machine_monitor import MachineMonitor, Resources, declared_resources
from .monitoring import MOST_TOLD, Findings, Monitoring, violation_text
from .properties import Property, Violation, shared_actuators, shared_keys
from .requirement_text import (
    RequirementError,
    Stated,
    Vocabulary,
    machine_vocabulary,
    parse_requirement,
    problems_with,
    read_requirements,
    tree_vocabulary,
)
from .requirements import (
    PROVED_ONLY,
    After,
    Apart,
    AtMost,
    Before,
    Has,
    IsA,
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
    'MOST_TOLD',
    'PROVED_ONLY',
    'After',
    'Apart',
    'AtMost',
    'Before',
    'Findings',
    'Has',
    'IsA',
    'MachineMonitor',
    'Monitoring',
    'Never',
    'Possible',
    'Property',
    'Requirement',
    'RequirementError',
    'Requirements',
    'Resources',
    'Stated',
    'TreeMonitor',
    'Violation',
    'Vocabulary',
    'While',
    'Within',
    'Written',
    'declared_resources',
    'machine_vocabulary',
    'parse_requirement',
    'problems_with',
    'read_requirements',
    'shared_actuators',
    'shared_keys',
    'tree_vocabulary',
    'violation_of',
    'violation_text',
]
