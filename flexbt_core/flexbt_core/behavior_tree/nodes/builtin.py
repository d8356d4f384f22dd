# SPDX-License-Identifier: BSD-3-Clause
"""The node types of BehaviorTree.CPP 4."""

from __future__ import annotations

from typing import Final

from flexbt_core.behavior_tree.engine.registry import NodeRegistry
from flexbt_core.behavior_tree.script.interpreter import ScriptLibrary

from . import blackboard, branches, decorators, loops, parallel, script_nodes, sequences, timing

FAMILIES: Final = (sequences, parallel, branches, decorators, loops, blackboard, script_nodes, timing)


def builtin_registry(scripts: ScriptLibrary | None = None) -> NodeRegistry:
    """Return a new registry with the node types of BehaviorTree.CPP."""
    registry = NodeRegistry(scripts)
    for family in FAMILIES:
        registry.register_classes(family.NODES)
    return registry
