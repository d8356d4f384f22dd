# SPDX-License-Identifier: BSD-3-Clause
"""Goals that become runs of trees, whatever the action is by which they came."""

from .progress import Speed, distance_along, distance_left, seconds_left
from .running_trees import RunningTree, TreeGoal
from .tree_goals import MESSAGE_LIMIT, RunParameters, TreeGoals
from .tree_reader import tree_reader

__all__ = [
    'MESSAGE_LIMIT',
    'RunParameters',
    'RunningTree',
    'Speed',
    'TreeGoal',
    'TreeGoals',
    'distance_along',
    'distance_left',
    'seconds_left',
    'tree_reader',
]
