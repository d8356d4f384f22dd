# SPDX-License-Identifier: BSD-3-Clause
"""Goals that become runs of trees, whatever the action is by which they came."""

from .progress import MOST_COUNTED, Speed, distance_along, distance_left, recoveries, seconds_left
from .running_trees import RunningTree, TreeGoal
from .tree_goals import MESSAGE_LIMIT, RunParameters, TreeGoals
from .tree_reader import tree_reader

__all__ = [
    'MESSAGE_LIMIT',
    'MOST_COUNTED',
    'RunParameters',
    'RunningTree',
    'Speed',
    'TreeGoal',
    'TreeGoals',
    'distance_along',
    'distance_left',
    'recoveries',
    'seconds_left',
    'tree_reader',
]
