# SPDX-License-Identifier: BSD-3-Clause
"""The registration of the leaves of this package."""

from __future__ import annotations

from typing import Final

from flexbt_core.behavior_tree import NodeRegistry
from flexbt_core.behavior_tree.nodes.nav2 import Dialect, of_dialect

from . import (
    behavior_leaf,
    navigation_actions,
    path_leaves,
    pause_resume_services,
    service_leaf,
    topic_decorators,
    topic_leaf,
)

FAMILIES: Final = (
    navigation_actions,
    behavior_leaf,
    service_leaf,
    topic_leaf,
    path_leaves,
    topic_decorators,
    pause_resume_services,
)


def register_leaves(registry: NodeRegistry, dialect: Dialect = 'jazzy') -> None:
    """Makes them known to ``registry``, as they are in that branch of Nav2."""
    for family in FAMILIES:
        registry.register_classes(of_dialect(family.NODES, dialect))
