# SPDX-License-Identifier: BSD-3-Clause
"""The registration of the nodes of Nav2 that need no ROS, of both branches."""

from __future__ import annotations

from typing import Final

from flexbt_core.behavior_tree.engine import NodeRegistry

from . import controls, error_codes, goals, paths, rates, sequences, timers
from .dialects import Dialect, register_dialects

FAMILIES: Final = (controls, sequences, paths, rates, goals, timers, error_codes)


def register_nav2(registry: NodeRegistry, dialect: Dialect = 'jazzy') -> None:
    """Registers all nodes of the families, as they are in that branch of Nav2 where a file does not show its own."""
    for family in FAMILIES:
        register_dialects(registry, family.NODES, dialect)
