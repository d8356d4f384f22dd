# SPDX-License-Identifier: BSD-3-Clause
"""Reader of mission files, and the check of trees that use one."""

from __future__ import annotations

from collections.abc import Collection, Iterator
from pathlib import Path
from typing import Final

from flexbt_core.behavior_tree.engine.registry import NodeRegistry, node_skills
from flexbt_core.behavior_tree.model.definition import NodeDefinition, TreeDefinition, TreeLibrary
from flexbt_core.behavior_tree.model.errors import LoadError
from flexbt_core.skills.library import SkillLibrary
from flexbt_core.skills.literals import SkillError
from flexbt_core.values.text import short_repr, truncate_middle
from flexbt_formal.planning.missions import Measurement, Mission, check_start, read_mission, skill_problem
from flexbt_formal.planning.planner import hopeless
from flexbt_formal.planning.problem import PlanningError
from flexbt_tools.errors import RefusedError, ToolError
from flexbt_tools.files import read_skill_files, read_text_file
from flexbt_tools.tree_checks.diagnostics import MISSION, Diagnostic
from flexbt_tools.trees.files import find_resource

_MOST_BYTES: Final = 1_000_000


def read_mission_file(file: str) -> Mission:
    """Return the mission of a file. Raises UsageError if it cannot be read, RefusedError with all its problems."""
    try:
        return read_mission(read_text_file(file, _MOST_BYTES), file)
    except PlanningError as error:
        raise RefusedError(mission_problems(file, Mission(), error)[0]) from error


def mission_skills(file: str, mission: Mission, base: SkillLibrary) -> SkillLibrary:
    """Return the skills of ``base``, and those of the mission's manifests, in files next to the mission file.

    Raises:
        RefusedError: with all problems of a manifest; a missing file is reported at the line that names it.
    """
    beside = [Path(file).parent / name for name in mission.skills]
    missing = [str(one) for one in beside if not one.exists()]
    if missing:
        line = mission.lines['skills']
        raise RefusedError(
            LoadError(file, line, 1, '', f'skills: there is no file {truncate_middle(one, 300)!r}') for one in missing
        )
    return read_skill_files([str(one) for one in beside], base)


def mission_problems(
    file: str, mission: Mission, error: Exception, given: Collection[str] = ()
) -> tuple[list[LoadError], list[str]]:
    """Return what is wrong with a mission: at the line that it names, or at that of the entry with which it begins; and
    what is wrong with the entries that are ``given`` in place of the file's."""
    located, others = [], []
    entries = {name: line for name, line in mission.lines.items() if name not in given}
    for problem in str(error).splitlines():
        line, separator, message = problem.removeprefix(f'{file}:').partition(': ')
        if not (separator and line.isdecimal()):
            message = problem.removeprefix('skills ')
            if message.startswith(tuple(given)):
                others.append(message)
                continue
            line = next((str(at) for name, at in entries.items() if message.startswith(name.removesuffix('s'))), '1')
        located.append(LoadError(file, int(line), 1, '', message))
    return located, others


# Check of the missions in the leaves of trees: can they be read, and can their goals be reached?

_LEAF = 'ReachGoal'


def missions(library: TreeLibrary, registry: NodeRegistry) -> Iterator[Diagnostic]:
    """Yield the problems of the missions of ``ReachGoal`` leaves, and why their goals cannot be reached."""
    base: SkillLibrary | None = None
    for key in library.tree_keys():
        tree = library.definition(key)
        for node in tree.nodes():
            name = _constant(node, 'mission')
            if node.manifest.id == _LEAF and name is not None:
                base = base or node_skills(registry, lambda text: None)  # the declaring part reports what is wrong
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
        check_start(library, mission.start)
        why = _why_hopeless(library, mission, goal, registry)
    except (PlanningError, SkillError) as error:
        located, words = mission_problems(file, mission, error, ['goal'] if given else [])
        yield from (Diagnostic(MISSION, one) for one in located)
        yield from (found(one, 'goal') for one in words)
        return
    if why:
        yield found(f'the goal {short_repr(goal)} of {name} cannot be reached: {why}', 'goal' if given else 'mission')


def _constant(node: NodeDefinition, port: str) -> str | None:
    """Return the value of a port in the tree: '' if the tree sets none, None if it comes from the blackboard."""
    value = node.values.get(port)
    return '' if value is None else value.text if value.key is None else None


def _why_hopeless(library: SkillLibrary, mission: Mission, goal: str, registry: NodeRegistry) -> str:
    """Return why the goal is unreachable even if each measured fact can become true or false at any time."""
    measured = Measurement.of(library, goal, registry.__contains__).leaves
    others = [[str(literal)] for atom in measured for literal in (atom, ~atom)]
    return hopeless(skill_problem(library, mission.start, goal, [*others, *mission.disturbances]))
