# SPDX-License-Identifier: BSD-3-Clause
"""Goals that become runs of trees, whatever the action is by which they came."""

from .distance_remaining import distance_along
from .running_trees import RunningTree, TreeGoal
from .tree_goals import MESSAGE_LIMIT, RunParameters, TreeGoals

__all__ = ['MESSAGE_LIMIT', 'RunParameters', 'RunningTree', 'TreeGoal', 'TreeGoals', 'distance_along']
