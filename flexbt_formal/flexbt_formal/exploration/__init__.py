# SPDX-License-Identifier: BSD-3-Clause
"""Proof: all that can happen to a tree, or to a machine, followed with the real engines.

::

    report = explore(lambda: TreeSystem(library, key), 'navigate.xml')
    for found in report.counterexamples:
        print(found.violation.text, *found.lines, sep='\\n')
"""

from flexbt_core.monitors import Property, Violation

from .choices import Choice, Choices
from .comparison import Comparison, Described, Difference, compare
from .configuration import Configuration, Memory
from .explorer import (
    DEFAULT_CONFIGURATIONS,
    DEFAULT_SECONDS,
    Limits,
    Moment,
    Progress,
    RestoreError,
    explore,
    narrate,
    replay,
    walk,
)
from .leaf_models import LeafKind, LeafModel, LeafModels, leaf_model
from .machine_system import Bounds, MachineSystem, Operator
from .model import OPERATOR, Counterexample, Label, Move, Report, System, servers_gone
from .state_models import StateKind, StateModel, StateModels, state_model
from .tree_system import TREE_LAYOUT, TreeSystem
from .virtual_time import VirtualClock

__all__ = [
    'DEFAULT_CONFIGURATIONS',
    'DEFAULT_SECONDS',
    'OPERATOR',
    'TREE_LAYOUT',
    'Bounds',
    'Choice',
    'Choices',
    'Comparison',
    'Configuration',
    'Counterexample',
    'Described',
    'Difference',
    'Label',
    'LeafKind',
    'LeafModel',
    'LeafModels',
    'Limits',
    'MachineSystem',
    'Memory',
    'Moment',
    'Move',
    'Operator',
    'Progress',
    'Property',
    'Report',
    'RestoreError',
    'StateKind',
    'StateModel',
    'StateModels',
    'System',
    'TreeSystem',
    'Violation',
    'VirtualClock',
    'compare',
    'explore',
    'leaf_model',
    'narrate',
    'replay',
    'servers_gone',
    'state_model',
    'walk',
]
