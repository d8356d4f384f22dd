# SPDX-License-Identifier: BSD-3-Clause
"""Behaviors without a robot: built but never run, checked together with the trees that they use, shown, drawn."""

from .behavior_picture import graph_of
from .built_behavior import BuiltBehavior, behavior_entry, build, installed, machine_file
from .check import check_behavior
from .findings import REFUSED, RULES, Finding
from .machine_text import machine_lines, reasons, structure_as_json
from .used_trees import TreeUse, UsedTrees, used_trees

__all__ = [
    'REFUSED',
    'RULES',
    'BuiltBehavior',
    'Finding',
    'TreeUse',
    'UsedTrees',
    'behavior_entry',
    'build',
    'check_behavior',
    'graph_of',
    'installed',
    'machine_file',
    'machine_lines',
    'reasons',
    'structure_as_json',
    'used_trees',
]
