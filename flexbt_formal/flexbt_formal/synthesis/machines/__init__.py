# SPDX-License-Identifier: BSD-3-Clause
"""Machines of strategies: the fewest states, userdata that is there, and their text."""

from .flexbe_form import state_instantiations
from .from_strategy import machine_of
from .machine import Part, State, SynthesizedMachine
from .python_text import machine_as_python
from .yaml_text import machine_as_yaml

__all__ = [
    'Part',
    'State',
    'SynthesizedMachine',
    'machine_as_python',
    'machine_as_yaml',
    'machine_of',
    'state_instantiations',
]
