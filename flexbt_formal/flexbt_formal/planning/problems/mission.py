# SPDX-License-Identifier: BSD-3-Clause
"""A mission as YAML: where it begins, what is to be reached, what others may do, and where the manifests are. ::

skills: [cup_skills.yaml]               # beside this file; the manifests of the leaves and the objects
start: [at(office), cup_at(kitchen)]    # what is not named does not hold
goal: cup_at(office) & not holding
disturbances:                           # each: what somebody else may bring about
  - [not open(door)]
robots: {red: [GoTo, Grasp], blue: [GoTo]}    # where there are several: what each can do
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import yaml

from flexbt_core.skills import SkillError, parse_literal
from flexbt_core.values import YamlParts, excerpt, line_of

from .model import PlanningError


@dataclass(frozen=True, slots=True)
class Mission:
    """What a file says. ``goal`` is '' where it says none. ``robots`` are those of several, each with its skills.
    ``lines`` has the line of each entry."""

    skills: tuple[str, ...] = ()
    start: tuple[str, ...] = ()
    goal: str = ''
    disturbances: tuple[tuple[str, ...], ...] = ()
    robots: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    lines: Mapping[str, int] = field(default_factory=dict)


def read_mission(text: str, source: str = '<text>') -> Mission:
    """The mission that a text describes.

    Raises:
        PlanningError: with everything that is wrong, each on a line as ``source:line: what``.
    """
    parts = YamlParts(source)
    entries = parts.mapping(parts.root(text), 'a mission')
    if 'predicates' in entries:
        raise PlanningError(f'{source}:1: these are skills, and no mission; a mission names their file: skills: [FILE]')
    parts.refuse_others(entries, ('skills', 'start', 'goal', 'disturbances', 'robots'), 'a mission')

    def literals(node: yaml.Node, what: str) -> tuple[str, ...]:
        found = []
        for one in parts.sequence(node, what):
            found.append(parts.name(one, f'what {what} lists', 'a literal such as on(cup, table)'))
            try:
                parse_literal(found[-1])
            except SkillError as error:
                parts.problem(one, str(error))
        return tuple(found)

    disturbances = parts.sequence(entries['disturbances'], 'disturbances') if 'disturbances' in entries else []
    robots = parts.mapping(entries.get('robots'), 'robots')
    if 'robots' in entries and not robots:
        parts.problem(entries['robots'], 'robots has to name one, with its skills; or leave it out')
    mission = Mission(
        tuple(parts.names(entries['skills'], 'skills')) if 'skills' in entries else (),
        literals(entries['start'], 'start') if 'start' in entries else (),
        parts.name(entries['goal'], 'the goal', 'a text such as on(cup, table)') if 'goal' in entries else '',
        tuple(literals(one, 'a disturbance') for one in disturbances),
        {name: tuple(parts.names(node, f'robot {excerpt(name)}')) for name, node in robots.items()},
        {name: line_of(node) for name, node in entries.items()},
    )
    if parts.problems:
        raise PlanningError('\n'.join(dict.fromkeys(parts.problems)))
    return mission
