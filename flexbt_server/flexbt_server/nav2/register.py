# SPDX-License-Identifier: BSD-3-Clause
"""The registration of the leaves of this package."""

from __future__ import annotations

from typing import Final

from flexbt_core.behavior_tree.engine.registry import NodeRegistry
from flexbt_core.behavior_tree.nodes.nav2.registration import Nav2Branch, register_branches
from flexbt_server.leaves import call_leaves
from flexbt_server.leaves.behavior_leaf import ExecuteBehavior

from . import (
    costmap_services,
    decorators,
    motion_actions,
    path_leaves,
    planning_actions,
    pose_leaves,
    services,
    topic_leaves,
)

FAMILIES: Final = (
    planning_actions,
    motion_actions,
    costmap_services,
    services,
    path_leaves,
    pose_leaves,
    topic_leaves,
    decorators,
)


def register_leaves(registry: NodeRegistry, nav2_branch: Nav2Branch = 'jazzy') -> None:
    """Register them in ``registry``. Files that do not show their branch of Nav2 get the nodes of ``nav2_branch``."""
    registry.register_classes([ExecuteBehavior, *call_leaves.NODES])
    for family in FAMILIES:
        register_branches(registry, family.NODES, nav2_branch)
