# SPDX-License-Identifier: BSD-3-Clause
"""The node types of BehaviorTree.CPP 4."""

from __future__ import annotations

from typing import Final

from flexbt_core.behavior_tree.engine import NodeRegistry
from flexbt_core.behavior_tree.script import ScriptLibrary

from . import (
    actions,
    conditionals,
    decorators,
    entry_updates,
    loops,
    parallel,
    reactive,
    script_nodes,
    sequences,
    switch,
    timing,
    try_catch,
)

FAMILIES: Final = (
    sequences,
    reactive,
    parallel,
    conditionals,
    switch,
    try_catch,
    decorators,
    loops,
    entry_updates,
    script_nodes,
    timing,
    actions,
)


def builtin_registry(scripts: ScriptLibrary | None = None) -> NodeRegistry:
    """A new registry with the node types of BehaviorTree.CPP."""
    registry = NodeRegistry(scripts)
    for family in FAMILIES:
        registry.register_classes(family.NODES)
    return registry
