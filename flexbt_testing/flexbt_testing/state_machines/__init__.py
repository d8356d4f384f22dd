# SPDX-License-Identifier: BSD-3-Clause
"""Machines and states for tests, without ROS: a bench on a manual clock, random machines, a model to compare with."""

from .bench import Bench, Do, Scripted, Snapshot, machine, nested, passing
from .counting_states import Add, Ask
from .random_machines import Node, Puppet, build, random_machine
from .reference_model import LIVELOCK, Model

__all__ = [
    'LIVELOCK',
    'Add',
    'Ask',
    'Bench',
    'Do',
    'Model',
    'Node',
    'Puppet',
    'Scripted',
    'Snapshot',
    'build',
    'machine',
    'nested',
    'passing',
    'random_machine',
]
