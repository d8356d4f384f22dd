# SPDX-License-Identifier: BSD-3-Clause
"""The executive as a ROS node."""

from .executive import Executive, open_executive
from .executive_parameters import ExecutiveParameters, declare_parameters
from .unconfigured_executive import UnconfiguredExecutive

__all__ = [
    'Executive',
    'ExecutiveParameters',
    'UnconfiguredExecutive',
    'declare_parameters',
    'open_executive',
]
