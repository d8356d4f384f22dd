# SPDX-License-Identifier: BSD-3-Clause
"""The behavior of the robot in the flat."""

from .reach_goal import TREE, ReachGoal

__all__ = ['TREE', 'ReachGoal']
