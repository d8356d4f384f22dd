# SPDX-License-Identifier: BSD-3-Clause
"""A mission in the words of manifests, as a problem of a planner."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from string import Template
from typing import Final

from flexbt_core.skills import (
    EQUAL,
    BlackboardSensor,
    ConditionSensor,
    GroundAction,
    Literal,
    Outcome,
    OutcomeClass,
    Skill,
    SkillError,
    SkillLibrary,
    ground,
    parse_literal,
)

from .goal import parse_goal
from .model import Action, PlanningError
from .problem import Leaf, Problem

_DISTURBANCE: Final = 'disturbance: '
_DEFAULT_ATTEMPTS: Final = 3


def skill_problem(
    library: SkillLibrary, start: Iterable[str], goal: str, disturbances: Sequence[Iterable[str]] = ()
) -> Problem:
    """What to plan.

    Args:
        library: skills and objects.
        start: literals that hold at the start; what is not named does not hold.
        goal: as :func:`parse_goal` takes it.
        disturbances: each the literals that others may make true.

    Raises:
        PlanningError, SkillError: a text is no literal, or speaks of what the library does not know.
    """
    return grounded_problem(library, start, goal, disturbances)[0]


def grounded_problem(
    library: SkillLibrary, start: Iterable[str], goal: str, disturbances: Sequence[Iterable[str]] = ()
) -> tuple[Problem, tuple[GroundAction, ...]]:
    """As :func:`skill_problem`, with the skills and objects of its actions."""
    alternatives = [[parse_literal(text) for text in one] for one in parse_goal(goal)]
    initial = [parse_literal(text) for text in start]
    disturbing = [_disturbance([parse_literal(text) for text in one]) for one in disturbances]
    known = library.skills.values()
    extended = SkillLibrary.of(
        [*known, *disturbing], library.predicates.values(), types=library.types, objects=library.objects
    )
    grounded = ground(extended, initial, [literal for one in alternatives for literal in one])
    actions = [action for action in grounded.actions if not action.skill.startswith(_DISTURBANCE)]
    others = [action for action in grounded.actions if action.skill.startswith(_DISTURBANCE)]
    if not actions:
        raise PlanningError('no skill can be done with these objects; name objects of the types that the skills have')
    leaves = {action.name: _action_leaf(library.skills[action.skill], action) for action in actions}
    texts = {text for action in grounded.actions for text in action.pre | action.add | action.delete} | grounded.goal
    leaves |= {text: leaf for text in texts if (leaf := sensor_leaf(library, parse_literal(text))) is not None}
    problem = Problem(
        tuple(map(_action, actions)),
        grounded.start,
        # What nothing changes and holds is no goal any more.
        tuple(frozenset(map(str, one)) & grounded.goal for one in alternatives),
        tuple(map(_action, others)),
        leaves,
        _remedies(extended),
    )
    return problem, tuple(actions)


def _remedies(library: SkillLibrary) -> dict[str, str]:
    """Of each predicate the skills that would bring it about if the start said what they need and none changes."""
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


def _action(action: GroundAction) -> Action:
    name = action.name.removesuffix('()') if action.skill.startswith(_DISTURBANCE) else action.name
    return Action(name.removeprefix(_DISTURBANCE), action.pre, action.add, action.delete, action.cost)


def _action_leaf(skill: Skill, action: GroundAction) -> Leaf:
    attempts = _DEFAULT_ATTEMPTS if skill.retries is None else skill.retries + 1
    return Leaf(action.skill, action.arguments, attempts=attempts, deadline=skill.deadline)


def sensor_leaf(library: SkillLibrary, literal: Literal) -> Leaf | None:
    """The leaf that tells whether a literal holds: that of the predicate's sensor, otherwise one that is called as the
    predicate. None when the library has no such predicate."""
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
    return Leaf(literal.predicate, arguments, inverted)  # no leaf of ours asks a topic, or remembers: the user's does
