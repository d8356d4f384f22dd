# SPDX-License-Identifier: BSD-3-Clause
"""The skill of a leaf: what its class declares, completed by what its ports and its outcomes tell."""

from __future__ import annotations

from flexbt_core.behavior_tree.model import FAILURE, RUNNING, SUCCESS, NodeKind, NodeManifest, OneOf
from flexbt_core.skills import Outcome, OutcomeClass, Skill

from .leaf import Condition, LeafNode, SyncAction


def node_skill(manifest: NodeManifest) -> Skill | None:
    """The skill of a node type; None when it is no leaf.

    A leaf reads and writes its ports, and ends by SUCCESS or FAILURE; a condition answers by them. One that derives
    from another has its skill, unless it declares its own.
    """
    node_class = manifest.node_class
    if not issubclass(node_class, LeafNode):
        return None
    rule = manifest.outcomes
    possible = rule.results if isinstance(rule, OneOf) else (SUCCESS, FAILURE, RUNNING)
    if manifest.kind is NodeKind.CONDITION:
        classes = {SUCCESS: OutcomeClass.ANSWERED, FAILURE: OutcomeClass.ANSWERED}
    else:
        classes = {SUCCESS: OutcomeClass.COMPLETED, FAILURE: OutcomeClass.FAILED}
    declared: object = node_class.skill
    skill = (declared if isinstance(declared, Skill) else Skill()).completed_by(
        manifest.id,
        {status.name: Outcome(kind) for status, kind in classes.items() if status in possible},
        reads=[name for name, port in manifest.ports.items() if port.readable],
        writes=[name for name, port in manifest.ports.items() if port.writable],
    )
    is_at_once = issubclass(node_class, SyncAction | Condition) or RUNNING not in possible
    return skill.lasting(0.0, 0.0) if is_at_once else skill
