# SPDX-License-Identifier: BSD-3-Clause
"""Missions in YAML, as planning problems in terms of skills, and the measurement of their initial state.

skills: [cup_skills.yaml]               # beside this file; the manifests of the leaves and the objects
start: [at(office), cup_at(kitchen)]    # all other literals are false
goal: cup_at(office) & not holding
disturbances:                           # each: literals that others may make true
  - [not open(door)]
robots: {red: [GoTo, Grasp], blue: [GoTo]}    # where there are several: what each can do
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import islice, product
from string import Template
from typing import Final, Self
from xml.etree import ElementTree

import yaml

from flexbt_core.skills.grounding import GroundAction, ground
from flexbt_core.skills.library import SkillLibrary, clashes
from flexbt_core.skills.literals import EQUAL, BlackboardSensor, ConditionSensor, Literal, SkillError, parse_literal
from flexbt_core.skills.skill import Outcome, OutcomeClass, Skill
from flexbt_core.values.text import truncate_middle
from flexbt_core.values.yaml_data import YamlParts, line_of

from .goal import parse_goal
from .problem import Action, Condition, Leaf, PlanningError, PlanningProblem


@dataclass(frozen=True, slots=True)
class Mission:
    """The contents of a mission file. ``goal`` is '' if the file has none. ``robots`` are the robots of a team, with
    their skills. ``lines`` has the line of each entry."""

    skills: tuple[str, ...] = ()
    start: tuple[str, ...] = ()
    goal: str = ''
    disturbances: tuple[tuple[str, ...], ...] = ()
    robots: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    lines: Mapping[str, int] = field(default_factory=dict)


def read_mission(text: str, source: str = '<text>') -> Mission:
    """Return the mission that a text describes.

    Raises:
        PlanningError: with all problems, each on a line in the form ``source:line: what``.
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
        {name: tuple(parts.names(node, f'robot {truncate_middle(name)}')) for name, node in robots.items()},
        {name: line_of(node) for name, node in entries.items()},
    )
    if parts.problems:
        raise PlanningError('\n'.join(dict.fromkeys(parts.problems)))
    return mission


# A mission in the words of manifests, as a problem of a planner.

_DISTURBANCE: Final = 'disturbance: '
_DEFAULT_ATTEMPTS: Final = 3
_NO_BINDING: Final[Mapping[str, str]] = {}


def check_start(library: SkillLibrary, start: Iterable[str]) -> None:
    """Raise SkillError: a text of the start of a mission is not a literal, or two of them cannot hold at once."""
    for one, other in clashes(library, [parse_literal(text, 'start') for text in start]):
        raise SkillError([f'start: {one} and {other} cannot hold at once ({one.predicate} is exclusive): name one'])


def skill_problem(
    library: SkillLibrary, start: Iterable[str], goal: str, disturbances: Sequence[Iterable[str]] = ()
) -> PlanningProblem:
    """Return the planning problem.

    Args:
        library: skills and objects.
        start: literals that hold at the start; all others do not hold.
        goal: in the syntax of :func:`parse_goal`.
        disturbances: each the literals that others may make true.

    Raises:
        PlanningError, SkillError: a text is not a literal, or uses names that the library does not know.
    """
    return grounded_problem(library, start, goal, disturbances)[0]


def grounded_problem(
    library: SkillLibrary, start: Iterable[str], goal: str, disturbances: Sequence[Iterable[str]] = ()
) -> tuple[PlanningProblem, tuple[GroundAction, ...]]:
    """Return the problem as :func:`skill_problem` does, with the skills and objects of its actions."""
    alternatives = [[parse_literal(text, 'goal') for text in one] for one in parse_goal(goal)]
    initial = [parse_literal(text, 'start') for text in start]
    disturbing = [_disturbance([parse_literal(text) for text in one]) for one in disturbances]
    skills = {one.name: one for one in (*library.skills.values(), *disturbing)}  # two equal disturbances are one
    extended = SkillLibrary.of(
        skills.values(), library.predicates.values(), types=library.types, objects=library.objects
    )
    grounded = ground(extended, initial, [literal for one in alternatives for literal in one])
    actions = [action for action in grounded.actions if not action.skill.startswith(_DISTURBANCE)]
    others = [action for action in grounded.actions if action.skill.startswith(_DISTURBANCE)]
    if not actions:
        raise PlanningError('no skill can be done with these objects; name objects of the types that the skills have')
    # Literals that hold and that no action changes are left out, unless they can be measured.
    asked = grounded.goal.union(*(_measured(library, one) for one in alternatives))
    needs = {
        one.name: one.pre | _measured(library, extended.skills[one.skill].preconditions, one.binding)
        for one in grounded.actions
    }
    held = (asked - grounded.goal).union(*(needs[one.name] - one.pre for one in grounded.actions))
    leaves = {action.name: _action_leaf(library.skills[action.skill], action) for action in actions}
    texts = {text for action in grounded.actions for text in action.add | action.delete}.union(asked, *needs.values())
    leaves |= {text: leaf for text in texts if (leaf := sensor_leaf(library, parse_literal(text))) is not None}
    problem = PlanningProblem(
        tuple(_action(one, needs[one.name]) for one in actions),
        grounded.start | held,
        tuple(frozenset(map(str, one)) & asked for one in alternatives),
        tuple(_action(one, one.pre) for one in others),
        leaves,
        _remedies(extended),
    )
    return problem, tuple(actions)


def _measured(
    library: SkillLibrary, literals: Iterable[Literal], binding: Mapping[str, str] = _NO_BINDING
) -> Condition:
    """Return those of the literals, bound to objects, whose predicates have a sensor that leaves can ask."""
    sensors = ((one, library.predicates.get(one.predicate)) for one in literals)
    return frozenset(
        str(one.bound(binding))
        for one, predicate in sensors
        if predicate is not None and isinstance(predicate.sensor, ConditionSensor | BlackboardSensor)
    )


def _remedies(library: SkillLibrary) -> dict[str, str]:
    """Return the skills that could make a predicate hold if the start satisfied their needs, by predicate."""
    effects = {
        skill.name: {effect.predicate for outcome in skill.outcomes.values() for effect in outcome.effects}
        for skill in library.skills.values()
    }
    changed = set[str]().union(*effects.values())
    fixed = {
        skill.name: ', '.join(str(one) for one in skill.preconditions if one.predicate not in {*changed, EQUAL})
        for skill in library.skills.values()
    }
    return {
        predicate: '; '.join(
            f'{skill} would, but needs {fixed[skill]}, which nothing changes: is it missing at the start?'
            for skill, brought in effects.items()
            if predicate in brought and fixed[skill]
        )
        for predicate in library.predicates
    }


def _disturbance(effects: list[Literal]) -> Skill:
    if not effects:
        raise SkillError(['disturbance without literals; name what others may make true'])
    name = _DISTURBANCE + ', '.join(map(str, effects))
    return Skill(name, outcomes={'SUCCESS': Outcome(OutcomeClass.COMPLETED, tuple(effects))})


def _action(action: GroundAction, needs: Condition) -> Action:
    name = action.name.removesuffix('()') if action.skill.startswith(_DISTURBANCE) else action.name
    return Action(name.removeprefix(_DISTURBANCE), needs, action.add, action.delete, action.cost)


def _action_leaf(skill: Skill, action: GroundAction) -> Leaf:
    attempts = _DEFAULT_ATTEMPTS if skill.retries is None else skill.retries + 1
    return Leaf(action.skill, action.arguments, attempts=attempts, deadline=skill.deadline)


def sensor_leaf(library: SkillLibrary, literal: Literal) -> Leaf | None:
    """Return the leaf that tests a literal: the leaf of the predicate's sensor, otherwise a leaf with the name of the
    predicate. None if the library does not know the predicate."""
    predicate = library.predicates.get(literal.predicate)
    if predicate is None:
        return None
    arguments = dict(zip(predicate.parameters, literal.arguments, strict=True))
    sensor = predicate.sensor
    inverted = not literal.positive
    if isinstance(sensor, ConditionSensor):
        ports = {port: Template(text).safe_substitute(arguments) for port, text in sensor.ports.items()}
        return Leaf(sensor.id, ports, inverted)
    if isinstance(sensor, BlackboardSensor):
        return Leaf('ScriptCondition', {'code': Template(sensor.test).safe_substitute(arguments)}, inverted)
    return Leaf(literal.predicate, arguments, inverted)  # FlexBT has no such leaf; the user's has


# Measurement of the initial state: a tree that ticks every sensor leaf once, and the start that follows.

MOST_FACTS: Final = 4096
"""Maximum number of facts that one tree measures."""


@dataclass(frozen=True, slots=True)
class Measurement:
    """The facts (atoms of objects) that leaves can measure, and the leaf for each."""

    leaves: dict[Literal, Leaf]

    @classmethod
    def of(cls, library: SkillLibrary, goal: str, is_type: Callable[[str], bool]) -> Self:
        """Return the facts about a library's objects that matter for a goal (see :func:`parse_goal`) and that leaves
        can measure without acting. ``is_type`` returns whether a leaf type exists.

        Raises:
            PlanningError, SkillError: the goal is invalid, or the facts are more than MOST_FACTS.
        """
        leaves: dict[Literal, Leaf] = {}
        acting = {
            skill.name
            for skill in library.skills.values()
            if any(one.effects and one.kind is not OutcomeClass.ANSWERED for one in skill.outcomes.values())
        }
        wanted = {parse_literal(text).predicate for alternative in parse_goal(goal) for text in alternative}
        for predicate in map(library.predicates.get, sorted(_that_matter(library, wanted))):
            if predicate is None:
                continue
            objects = [library.objects_of(kind) for kind in predicate.parameters.values()]
            for arguments in islice(product(*objects), MOST_FACTS + 1):
                atom = Literal(predicate.name, arguments)
                leaf = sensor_leaf(library, atom)
                if leaf is None or not is_type(leaf.type) or leaf.type in acting:
                    break
                leaves[atom] = leaf
            if len(leaves) > MOST_FACTS:
                raise SkillError(
                    [
                        f'more than {MOST_FACTS} facts would have to be measured, with those of {predicate.name}; '
                        'name fewer objects, or let predicates that never change do without sensor'
                    ]
                )
        return cls(leaves)

    def tree_xml(self, name: str) -> str:
        """Return a tree of this ID that succeeds once every sensor has answered; :meth:`start` reads the answers.

        Raises:
            PlanningError: XML cannot contain the type or a port of a leaf.
        """
        root = ElementTree.Element('root', BTCPP_format='4', main_tree_to_execute=name)
        tree = ElementTree.SubElement(root, 'BehaviorTree', ID=name)
        asked = ElementTree.SubElement(tree, 'Sequence', name='how the world is')
        for number, (atom, leaf) in enumerate(self.leaves.items()):
            answered = ElementTree.SubElement(asked, 'ForceSuccess')
            said = {'_onSuccess': f'{_entry(number)} := true', '_onFailure': f'{_entry(number)} := false'}
            ElementTree.SubElement(answered, leaf.type, {**leaf.attributes(str(atom)), **said})
        ElementTree.SubElement(asked, 'AlwaysSuccess')  # for a goal without sensors
        return ElementTree.tostring(root, encoding='unicode')

    def start(self, given: Iterable[str], holds: Callable[[str], bool]) -> list[str]:
        """Return the literals that hold at the start: the measured ones, and those in ``given`` that no sensor
        measures.

        ``holds`` returns whether an entry of the tree's blackboard exists and is true.

        Raises:
            SkillError: one of ``given`` is not a literal.
        """
        remembered = [literal for literal in map(parse_literal, given) if literal.atom not in self.leaves]
        measured = [atom for number, atom in enumerate(self.leaves) if holds(_entry(number))]
        return [*map(str, remembered), *map(str, measured)]


def _that_matter(library: SkillLibrary, wanted: set[str]) -> set[str]:
    """Return the wanted predicates, and, recursively, the condition predicates of skills that can change them."""
    found = set(wanted)
    pending = list(library.skills.values())
    while bringing := [skill for skill in pending if not found.isdisjoint(_brought_about(skill))]:
        found.update(literal.predicate for skill in bringing for literal in skill.preconditions)
        pending = [skill for skill in pending if skill not in bringing]
    return found


def _brought_about(skill: Skill) -> set[str]:
    return {effect.predicate for outcome in skill.outcomes.values() for effect in outcome.effects}


def _entry(number: int) -> str:
    """Return the name of a private blackboard entry."""
    return f'_fact_{number}'
