# SPDX-License-Identifier: BSD-3-Clause
"""The node ``simulator``: a world on ROS, with the topics of its robots and the standard services of simulators."""

from .description import robot_description
from .node import Simulator
from .parameters import SimulatorParameters, built_in_map, declare_simulator_parameters

__all__ = [
    'Simulator',
    'SimulatorParameters',
    'built_in_map',
    'declare_simulator_parameters',
    'robot_description',
]
