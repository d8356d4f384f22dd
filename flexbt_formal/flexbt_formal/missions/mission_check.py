# SPDX-License-Identifier: BSD-3-Clause
"""The missions that the leaves of trees are to reach: whether they can be read, and whether there may be a way."""

from __future__ import annotations

from collections.abc import Iterator

from flexbt_core.behavior_tree import NodeDefinition, NodeRegistry, TreeDefinition, TreeLibrary, node_skills
from flexbt_core.skills import SkillError, SkillLibrary
from flexbt_core.values import shown
from flexbt_formal.planning import Measurement, Mission, PlanningError, hopeless, skill_problem
from flexbt_tools.errors import RefusedError, ToolError
from flexbt_tools.tree_checks import MISSION, Diagnostic
from flexbt_tools.trees import find_resource

from .mission_files import mission_problems, mission_skills, read_mission_file

_LEAF = 'ReachGoal'


def missions(library: TreeLibrary, registry: NodeRegistry) -> Iterator[Diagnostic]:
    """What is wrong with the missions that leaves ``ReachGoal`` name, and why their goals cannot be reached."""
    base: SkillLibrary | None = None
    for key in library.tree_keys():
        tree = library.definition(key)
        for node in tree.nodes():
            name = _constant(node, 'mission')
            if node.manifest.id == _LEAF and name is not None:
                base = base or node_skills(registry, lambda text: None)  # who declares it is told of what is wrong
                yield from _of_leaf(tree, node, name, registry, base)


def _of_leaf(
    tree: TreeDefinition, node: NodeDefinition, name: str, registry: NodeRegistry, base: SkillLibrary
) -> Iterator[Diagnostic]:
    def found(message: str, attribute: str = 'mission') -> Diagnostic:
        return Diagnostic(MISSION, tree.error(node, message, attribute))

    try:
        file = name if name.startswith('/') else str(find_resource(name))
        mission = read_mission_file(file)
        if mission.robots:
            yield found(f'{name} is for several robots; let bt_tool plan write its trees, and run those')
            return
        library = mission_skills(file, mission, base)
    except RefusedError as error:
        yield from (Diagnostic(MISSION, one) for one in error.errors)
        return
    except (OSError, ToolError) as error:
        yield found(str(error))
        return
    given = _constant(node, 'goal')
    goal = given or mission.goal
    if not goal:
        if given is not None:
            yield found(f'{name} names no goal; add it there (goal: ...), or give the port goal')
        return
    try:
        why = _why_hopeless(library, mission, goal, registry)
    except (PlanningError, SkillError) as error:
        located, words = mission_problems(file, mission, error, ['goal'] if given else [])
        yield from (Diagnostic(MISSION, one) for one in located)
        yield from (found(one, 'goal') for one in words)
        return
    if why:
        yield found(f'the goal {shown(goal)} of {name} cannot be reached: {why}', 'goal' if given else 'mission')


def _constant(node: NodeDefinition, port: str) -> str | None:
    """What the tree says; '' where it says nothing, None where it is on the blackboard."""
    value = node.values.get(port)
    return '' if value is None else value.text if value.key is None else None


def _why_hopeless(library: SkillLibrary, mission: Mission, goal: str, registry: NodeRegistry) -> str:
    """Whatever sensors measure may hold, or not hold, at the start and later on."""
    measured = Measurement.of(library, goal, registry.__contains__).leaves
    others = {(str(literal),) for atom in measured for literal in (atom, ~atom)} | set(mission.disturbances)
    return hopeless(skill_problem(library, mission.start, goal, sorted(others)))
