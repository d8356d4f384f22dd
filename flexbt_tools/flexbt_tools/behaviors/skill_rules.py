# SPDX-License-Identifier: BSD-3-Clause
"""Whether the states of a behavior keep to what their skills say, and leave each other their actuators."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from itertools import combinations
from typing import Final

from flexbt_core.skills import Skill, SkillLibrary
from flexbt_core.state_machine import MachineDefinition, StateDefinition, StateKind, state_skill
from flexbt_core.values import hint
from flexbt_tools.tree_checks import SHARED_RESOURCE, tree_resources

from .findings import SKILL, Finding
from .used_trees import UsedTrees

Users = Mapping[str, str]
"""The actuators that something needs, and who needs it, as it is named to users; one of several."""

_NO_TIME: Final = (0.0, 0.0)


def findings_of(machine: MachineDefinition, trees: UsedTrees, skills: SkillLibrary) -> Iterator[Finding]:
    """What is found. ``skills`` are those of the leaves, and those that files declare."""
    needs: dict[str, Users] = {}  # by path
    of_trees = tree_resources(trees.library, skills)
    for use in trees.uses:
        if use.key is not None:
            leaves = of_trees[use.key].items()
            needs[use.path] = {name: f'{use.path} ({leaf} in tree {use.key.id})' for name, leaf in leaves}
    for node in reversed(list(machine.nodes())):
        if isinstance(node, StateDefinition):
            skill = _skill(node, skills)
            yield from _outcomes(node, skill)
            if skill.duration != _NO_TIME:
                needs[node.path] = {**needs.get(node.path, {}), **dict.fromkeys(skill.resources, node.path)}
            continue
        children = [needs.get(child.path, {}) for child in node.children.values()]
        # What has priority runs while all others are paused.
        alone = node.kind is StateKind.PRIORITY
        needs[node.path] = {} if alone else {name: user for one in reversed(children) for name, user in one.items()}
        if node.kind is StateKind.CONCURRENCY:
            for one, other in combinations(children, 2):
                for name in one.keys() & other.keys():
                    message = f'{one[name]} and {other[name]} need [{name}] for themselves, and run at the same time'
                    yield Finding(SHARED_RESOURCE, node.path, message)


def _skill(node: StateDefinition, skills: SkillLibrary) -> Skill:
    own = state_skill(node.state)
    told = skills.skills.get(own.name)
    return own if told is None else told.completed_by('', own.outcomes, own.reads, own.writes)


def _outcomes(node: StateDefinition, skill: Skill) -> Iterator[Finding]:
    """Outcomes of which the skill says nothing, or of which only the skill knows."""
    for name, outcome in skill.outcomes.items():
        if name not in node.outcomes:
            known = hint(name, node.outcomes)
            message = f'its skill speaks of the outcome {name!r:.80}, which the state does not have{known}'
            yield Finding(SKILL, node.path, message)
        elif outcome.kind is None and (skill.preconditions or any(one.effects for one in skill.outcomes.values())):
            message = f'its skill does not say what the outcome {name!r:.80} means; give it a class, such as failed'
            yield Finding(SKILL, node.path, message)
