# SPDX-License-Identifier: BSD-3-Clause
"""Checks of the actuators that trees need, and of nodes that need the same actuator at the same time."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from itertools import combinations
from typing import Final

from flexbt_core.behavior_tree.engine.parents import ControlNode
from flexbt_core.behavior_tree.engine.registry import node_skill
from flexbt_core.behavior_tree.model.definition import NodeDefinition, TreeKey, TreeLibrary
from flexbt_core.skills.library import SkillLibrary
from flexbt_core.skills.skill import Skill
from flexbt_tools.trees.files import sub_trees_first

from .diagnostics import SHARED_RESOURCE, Diagnostic

Resources = Mapping[str, str]
"""The required actuators, each with the user-visible name of one leaf that needs it."""

NO_SKILLS: Final = SkillLibrary()


def tree_resources(library: TreeLibrary, skills: SkillLibrary = NO_SKILLS) -> dict[TreeKey, Resources]:
    """Return the actuators that each tree needs. ``skills`` that files declare replace those of the classes."""
    return {key: resources for key, resources, _ in _trees(library, skills)}


def shared_resources(library: TreeLibrary, skills: SkillLibrary = NO_SKILLS) -> Iterator[Diagnostic]:
    """Yield a finding for each pair of children that may run at once and need the same actuator."""
    for _, _, found in _trees(library, skills):
        yield from found


def _trees(library: TreeLibrary, skills: SkillLibrary) -> Iterator[tuple[TreeKey, Resources, list[Diagnostic]]]:
    known: dict[TreeKey, Resources] = {}
    for key in sub_trees_first(library):
        tree = library.definition(key)
        needs: dict[int, Resources] = {}
        found = []
        for node in reversed(list(tree.nodes())):
            if node.tree_id is not None:
                target = library.find(node.tree_id, key.file)
                needs[id(node)] = known[target] if target is not None else {}
                continue
            children = [needs[id(child)] for child in node.children]
            own = skill_of(node, skills)
            needs[id(node)] = _united(children, node, own)
            node_class = node.manifest.node_class
            if issubclass(node_class, ControlNode) and node_class.runs_several:
                found += [
                    Diagnostic(SHARED_RESOURCE, tree.error(second, _message(name, node, one[name], other[name])))
                    for (_, one), (second, other) in combinations(zip(node.children, children, strict=True), 2)
                    for name in one.keys() & other.keys()
                ]
        known[key] = needs[id(tree.root)]
        yield key, known[key], found


def _united(children: list[Resources], node: NodeDefinition, skill: Skill | None) -> Resources:
    united: dict[str, str] = {}
    for child in children:
        united |= {name: leaf for name, leaf in child.items() if name not in united}
    if skill is not None and skill.duration != (0.0, 0.0):
        united |= dict.fromkeys(skill.resources, node.label)
    return united


def skill_of(node: NodeDefinition, skills: SkillLibrary) -> Skill | None:
    """Return the skill of a leaf, from a file or from its class; None if the node is not a leaf."""
    return skills.skills.get(node.manifest.id) or node_skill(node.manifest)


def _message(resource: str, parent: NodeDefinition, first: str, second: str) -> str:
    both = f'{first} and {second}' if first != second else f'two {first}'
    return f'{both} need [{resource}] for themselves, and may run at once in {parent.label}'
