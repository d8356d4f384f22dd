# SPDX-License-Identifier: BSD-3-Clause
"""The leaves of this package under the names that XML uses."""

from __future__ import annotations

from typing import Final

from flexbt_core.behavior_tree import NodeRegistry, TreeNode
from flexbt_core.behavior_tree.nodes.nav2 import Dialect

from . import (
    behavior_leaf,
    navigation_actions,
    path_leaves,
    pause_resume_services,
    service_leaf,
    topic_decorators,
    topic_leaf,
)

LEAVES: Final[tuple[type[TreeNode], ...]] = (
    navigation_actions.ComputePathToPose,
    navigation_actions.ComputePathThroughPoses,
    navigation_actions.FollowPath,
    navigation_actions.Spin,
    navigation_actions.BackUp,
    navigation_actions.DriveOnHeading,
    navigation_actions.Wait,
    behavior_leaf.ExecuteBehavior,
    service_leaf.ClearEntireCostmap,
    service_leaf.IsPathValid,
    service_leaf.CancelControl,
    service_leaf.CancelSpin,
    service_leaf.CancelBackUp,
    service_leaf.CancelWait,
    service_leaf.CancelDriveOnHeading,
    topic_leaf.ControllerSelector,
    topic_leaf.PlannerSelector,
    topic_leaf.SmootherSelector,
    topic_leaf.GoalCheckerSelector,
    topic_leaf.ProgressCheckerSelector,
    path_leaves.TruncatePath,
    path_leaves.RemovePassedGoals,
    topic_decorators.DistanceController,
    topic_decorators.SpeedController,
    pause_resume_services.PauseResumeController,
)


def register_leaves(registry: NodeRegistry, dialect: Dialect = 'jazzy') -> None:
    """Make them known to ``registry``, as they are in that branch of Nav2."""
    for leaf in LEAVES:
        registry.register(leaf.__name__, leaf)
    updater = topic_decorators.GoalUpdater if dialect == 'jazzy' else topic_decorators.GoalUpdaterOfMain
    registry.register('GoalUpdater', updater)
