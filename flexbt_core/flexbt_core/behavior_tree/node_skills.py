# SPDX-License-Identifier: BSD-3-Clause
"""The skills of leaves: what their classes declare, completed by what ports and outcomes tell."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from dataclasses import replace

from flexbt_core.behavior_tree.engine import Condition, LeafNode, NodeRegistry, SyncAction
from flexbt_core.behavior_tree.model import FAILURE, RUNNING, SUCCESS, NodeKind, NodeManifest, OneOf
from flexbt_core.skills import Outcome, OutcomeClass, Skill, SkillLibrary


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
