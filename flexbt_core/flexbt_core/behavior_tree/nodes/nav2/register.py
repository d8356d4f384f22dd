# SPDX-License-Identifier: BSD-3-Clause
"""The registration of the nodes of Nav2 that need no ROS, of both branches."""

from __future__ import annotations

from typing import Final

from flexbt_core.behavior_tree.engine import NodeRegistry

from . import controls, error_codes, goals, paths, rates, sequences, timers
from .branches import Nav2Branch, register_branches

FAMILIES: Final = (controls, sequences, paths, rates, goals, timers, error_codes)


def register_nav2(registry: NodeRegistry, nav2_branch: Nav2Branch = 'jazzy') -> None:
    """Registers all nodes of the families, as they are in that branch of Nav2 where a file does not show its own."""
    for family in FAMILIES:
        register_branches(registry, family.NODES, nav2_branch)
