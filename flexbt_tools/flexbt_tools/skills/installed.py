# SPDX-License-Identifier: BSD-3-Clause
"""The skills of the node types that are installed."""

from __future__ import annotations

from flexbt_core.behavior_tree import NodeRegistry, node_skill
from flexbt_core.skills import SkillLibrary


def node_skills(registry: NodeRegistry) -> SkillLibrary:
    """The skills of all leaves of a registry. Raises SkillError when what classes declare does not fit together."""
    skills = (node_skill(manifest) for manifest in registry)
    return SkillLibrary.of(skill for skill in skills if skill is not None)
