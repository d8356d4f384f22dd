# SPDX-License-Identifier: BSD-3-Clause
"""The skills of all node types of a registry, as one library."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from dataclasses import replace

from flexbt_core.behavior_tree.model import NodeManifest
from flexbt_core.skills import Skill, SkillLibrary

from .node_skill import node_skill
from .registry import NodeRegistry


def node_skills(registry: NodeRegistry, broken: Callable[[str], None]) -> SkillLibrary:
    """The skills of all leaves of a registry.

    What a class declares and does not fit is told to ``broken``, with file and line of the class; of its skill only the
    resources and what the outcomes mean are kept then, so that one wrong package does not keep others from their work.
    """
    manifests = {manifest.id: manifest for manifest in registry}
    skills = {id: skill for id, manifest in manifests.items() if (skill := node_skill(manifest)) is not None}
    while True:
        library, problems = SkillLibrary.joined(skills.values())
        if not problems:
            return library
        for at, text in problems:
            section, name, *inside = at
            ids = [name] if section == 'skills' else [id for id, one in skills.items() if _declares(one, name)]
            for id in ids:
                where = ' '.join(inside) if section == 'skills' else f'predicate {name}'
                broken(f'{_place(manifests[id])}: skill of {id}: {where + ": " if where else ""}{text}')
                skills[id] = _without_literals(skills[id])


def _declares(skill: Skill, predicate: str) -> bool:
    return any(one.name == predicate for one in skill.predicates)


def _without_literals(skill: Skill) -> Skill:
    outcomes = {name: replace(one, effects=()) for name, one in skill.outcomes.items()}
    return replace(skill, parameters={}, preconditions=(), outcomes=outcomes, arguments={}, predicates=())


def _place(manifest: NodeManifest) -> str:
    """File and line of the class of a node type."""
    node_class = manifest.node_class
    try:
        return f'{inspect.getsourcefile(node_class)}:{inspect.getsourcelines(node_class)[1]}'
    except (OSError, TypeError):  # made by a program
        return f'{node_class.__module__}.{node_class.__qualname__}'
