# SPDX-License-Identifier: BSD-3-Clause
"""Costmaps: a map with what is seen on it, inflated, and the loops over their cells that planners need. Pure."""

from .acceleration import loops
from .costmap import INSCRIBED, LETHAL, Box, Costmap, Inflation, Position
from .kernels import Bools, Costs, Squares, Weights, neighbours
from .layers import LayeredCostmap, Observation, local_size

__all__ = [
    'INSCRIBED',
    'LETHAL',
    'Bools',
    'Box',
    'Costmap',
    'Costs',
    'Inflation',
    'LayeredCostmap',
    'Observation',
    'Position',
    'Squares',
    'Weights',
    'local_size',
    'loops',
    'neighbours',
]
