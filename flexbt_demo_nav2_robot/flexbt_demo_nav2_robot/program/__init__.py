# SPDX-License-Identifier: BSD-3-Clause
"""The program of the robot, on the interface of nav2_simple_commander."""

from .deliveries import Deliveries
from .navigator import Navigator, TaskResult

__all__ = ['Deliveries', 'Navigator', 'TaskResult']
