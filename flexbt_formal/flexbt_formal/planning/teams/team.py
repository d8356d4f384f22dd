# SPDX-License-Identifier: BSD-3-Clause
"""A problem for several robots: which of them does what."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final

from flexbt_core.skills import ANYTHING, SkillError, SkillLibrary, parse_literal
from flexbt_core.values import hint, shown
from flexbt_formal.planning.problems import Action, Leaf, PlanningError, Problem, grounded_problem

_ROBOT: Final = 'robot'
"""The parameter of a skill for who does it, and the type of robots."""
_MOST: Final = 8


@dataclass(frozen=True, slots=True)
class Team:
    """What is to be planned for several robots.

    ``doers`` tells for each action of the problem, by its name, which of the ``robots`` does it. A robot does one
    action at a time. Costs are durations where the time that the team needs is to count.

    Raises:
        PlanningError: there is no robot, or more than 8; or nobody of them does an action.
    """

    problem: Problem
    robots: tuple[str, ...]
    doers: Mapping[str, str]

    def __post_init__(self) -> None:
        if not 1 <= len(set(self.robots)) == len(self.robots) <= _MOST:
            raise PlanningError(f'{len(self.robots)} robots: name 1 to {_MOST}, each once')
        if len({entry('', robot) for robot in self.robots}) < len(self.robots):
            raise PlanningError(f'robots {", ".join(self.robots)}: two differ in punctuation only; rename one')
        for action in self.problem.actions:
            if self.doers.get(action.name) not in self.robots:
                raise PlanningError(f'action {action.name}: none of the robots {", ".join(self.robots)} does it')


def team_problem(
    library: SkillLibrary,
    start: Iterable[str],
    goal: str,
    robots: Mapping[str, Collection[str]],
    disturbances: Sequence[Iterable[str]] = (),
) -> Team:
    """What to plan, from manifests.

    ``robots`` names them, each with its skills. Who does a skill is its parameter ``robot``; a skill without one is
    done by any robot that has it. Robots that the library does not name are objects of the type ``robot``. The others
    as for :func:`skill_problem`.

    Raises:
        PlanningError, SkillError: as there; or a robot has a skill that there is not.
    """
    for robot, skills in robots.items():
        _check_name(robot)
        for skill in skills:
            if skill not in library.skills:
                raise PlanningError(f'robots: {robot}: there is no skill {shown(skill)}{hint(skill, library.skills)}')
    objects = {**dict.fromkeys(robots, _ROBOT), **library.objects}
    had = {skill for skills in robots.values() for skill in skills}
    library = SkillLibrary.of(
        [skill for skill in library.skills.values() if skill.name in had],
        library.predicates.values(),
        types={_ROBOT: ANYTHING, **library.types},
        objects=objects,
    )
    problem, grounded = grounded_problem(library, start, goal, disturbances)
    actions: list[Action] = []
    leaves = dict(problem.leaves)
    doers: dict[str, str] = {}
    for action, ground in zip(problem.actions, grounded, strict=True):
        if _ROBOT in ground.binding:
            robot = ground.binding[_ROBOT]
            if ground.skill in robots.get(robot, ()):
                actions.append(action)
                doers[action.name] = robot
            continue
        for robot, skills in robots.items():
            if ground.skill in skills:
                own = f'{robot}: {action.name}'
                actions.append(replace(action, name=own))
                leaves[own] = problem.leaf(action.name)
                doers[own] = robot
    if not actions:
        raise PlanningError('robots: none of their skills can be done with these objects')
    return Team(replace(problem, actions=tuple(actions), leaves=leaves), tuple(robots), doers)


def _check_name(robot: str) -> None:
    """Whether literals can speak of a robot."""
    try:
        named = parse_literal(f'{_ROBOT}({robot})').arguments == (robot,)
    except SkillError:
        named = False
    if not named:
        raise PlanningError(f'robots: {shown(robot)} cannot name a robot: letters, digits and _.:/@-')


def staffed(team: Team) -> Problem:
    """The problem, in which a robot that is lost does nothing any more, and any of them may be lost."""
    serving = {robot: in_service(robot) for robot in team.robots}
    problem = team.problem
    return replace(
        problem,
        actions=tuple(replace(one, needs=one.needs | {serving[team.doers[one.name]]}) for one in problem.actions),
        initial=problem.initial | set(serving.values()),
        disturbances=(
            *problem.disturbances,
            *(
                Action(f'{robot} is lost', frozenset({serves}), frozenset(), frozenset({serves}))
                for robot, serves in (serving.items() if len(serving) > 1 else ())
            ),
        ),
        leaves={
            **problem.leaves,
            **{
                serves: Leaf('ScriptCondition', {'code': f'!{entry("lost", robot)}'})
                for robot, serves in serving.items()
            },
        },
    )


def in_service(robot: str) -> str:
    """The literal that a robot works."""
    return f'{robot} is in service'


def entry(what: str, robot: str) -> str:
    """The entry of the blackboard with what is known of a robot."""
    return f'{what}_' + ''.join(one if one.isascii() and one.isalnum() else '_' for one in robot)
