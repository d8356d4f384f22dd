# SPDX-License-Identifier: BSD-3-Clause
"""The node ``navigation`` with its servers."""

from .motion_server import MotionArbiter
from .navigation_parameters import declare_navigation_parameters
from .navigation_servers import Navigation

__all__ = [
    'MotionArbiter',
    'Navigation',
    'declare_navigation_parameters',
]
