# SPDX-License-Identifier: BSD-3-Clause
"""Everything that is wrong, or suspicious, in behaviors and between them and their trees."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

from flexbt_core.behavior_tree import NodeRegistry
from flexbt_core.skills import SkillLibrary

from . import machine_rules, skill_rules, tree_rules
from .built_behavior import BuiltBehavior
from .findings import REFUSED, RULES, Finding
from .used_trees import used_trees

_NO_SKILLS: Final = SkillLibrary()
_ORDER = {rule.name: index for index, rule in enumerate(RULES)}


def check_behavior(
    behavior: BuiltBehavior,
    files: Sequence[str],
    registry: NodeRegistry,
    skills: SkillLibrary = _NO_SKILLS,
    inputs: Sequence[str] = (),
) -> list[Finding]:
    """What is found in a behavior: errors first. ``files`` are tree files that the BT server has besides;
    ``skills`` are those of the leaves, and those that files declare. The blackboard keys ``inputs`` are written from
    outside."""
    if behavior.machine is None:
        return [Finding(REFUSED, '', problem) for problem in behavior.problems]
    used = used_trees(behavior.machine, files, registry)
    found = [*used.findings, *machine_rules.findings_of(behavior.machine), *tree_rules.findings_of(used, inputs)]
    found += skill_rules.findings_of(behavior.machine, used, skills)
    return sorted(dict.fromkeys(found), key=lambda one: _ORDER[one.rule.name])
