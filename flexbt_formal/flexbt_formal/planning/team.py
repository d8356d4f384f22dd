# SPDX-License-Identifier: BSD-3-Clause
"""Plans for several robots: the problem, and the tested actions of each robot."""

from __future__ import annotations

import time
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final, NamedTuple

from flexbt_core.skills.library import ANYTHING, SkillLibrary
from flexbt_core.skills.literals import SkillError, parse_literal
from flexbt_core.values.text import did_you_mean, short_repr

from .coverage import Disturbance, explore_states
from .division import Divider, branches_of
from .missions import grounded_problem
from .planner import Plan, compiled, why_not
from .policy import WAITS, Policy, actions_of
from .problem import Action, Leaf, PlanningError, PlanningProblem, bits
from .relaxation import Reachability
from .search import SearchOutcome, SearchProgress

_ROBOT: Final = 'robot'
"""The parameter of a skill that selects its robot; also the object type of robots."""
_MOST: Final = 8


@dataclass(frozen=True, slots=True)
class Team:
    """A problem to plan for several robots.

    ``doers`` maps each action of the problem, by its name, to the one of the ``robots`` that does it. A robot does one
    action at a time. Costs are durations if the plan is to minimize the team's time.

    Raises:
        PlanningError: the team has no robot, more than 8, or an action without a robot.
    """

    problem: PlanningProblem
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
    """Return the planning problem of a team, from manifests.

    ``robots`` maps each robot to its skills. The parameter ``robot`` of a skill selects its robot; any robot that has a
    skill without this parameter can execute it. Robots that the library does not know become objects of the type
    ``robot``. The other parameters are as for :func:`skill_problem`.

    Raises:
        PlanningError, SkillError: as for :func:`skill_problem`; or a robot has an unknown skill.
    """
    for robot, skills in robots.items():
        _check_name(robot)
        for skill in skills:
            if skill not in library.skills:
                raise PlanningError(
                    f'robots: {robot}: there is no skill {short_repr(skill)}{did_you_mean(skill, library.skills)}'
                )
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
    """Check that literals can name a robot. Raises PlanningError if not."""
    try:
        named = parse_literal(f'{_ROBOT}({robot})').arguments == (robot,)
    except SkillError:
        named = False
    if not named:
        raise PlanningError(f'robots: {short_repr(robot)} cannot name a robot: letters, digits and _.:/@-')


def staffed(team: Team) -> PlanningProblem:
    """Return the problem extended by losses: any robot may be lost, and a lost robot does nothing."""
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
    """Return the literal for a robot that is in service."""
    return f'{robot} is in service'


def entry(what: str, robot: str) -> str:
    """Return the name of a blackboard entry of a robot."""
    return f'{what}_' + ''.join(one if one.isascii() and one.isalnum() else '_' for one in robot)


# Planning for several robots; the trees are tested before they are returned.


class Task(NamedTuple):
    """An action of a robot with its begin and end, if costs are durations and no disturbance occurs."""

    robot: str
    action: str
    begins: float
    ends: float


@dataclass(frozen=True, slots=True, kw_only=True)
class TeamPlan(Plan):
    """The result of planning for several robots.

    ``tasks``: the plan, ordered by begin. ``duration``: the end of the last task. ``cost``: the total cost.
    ``least_duration``: a lower bound of the duration of any plan. ``alone``: for each robot, the cost of reaching the
    goal
    alone (None: it cannot, or the cost is unknown).
    """

    team: Team
    least_duration: float = 0.0
    tasks: tuple[Task, ...] = ()
    duration: float | None = None
    alone: dict[str, float | None] | None = None

    @property
    def unlimited(self) -> tuple[str, ...]:
        """The types of its leaves that have no deadline: if one never ends, the loss of its robot is not detected."""
        members = self.policy.members if self.policy is not None else ()
        actions = {action for robot in members for action in actions_of(robot)} - {WAITS}
        leaves = (self.problem.leaf(self.problem.actions[action].name) for action in actions)
        return tuple(sorted({leaf.type for leaf in leaves if leaf.deadline is None}))


def plan_team(
    team: Team,
    *,
    time_limit: float = 60.0,
    disturbed: int = 1,
    report: Callable[[SearchProgress], None] | None = None,
    clock: Callable[[], float] = time.perf_counter,
) -> TeamPlan:
    """Plan for several robots, and test the result in all states that are reachable with up to ``disturbed``
    disturbances. The loss of a robot is a disturbance.

    States without a branch are planned for as well. ``time_limit`` is in seconds on the ``clock``. After it, the result
    contains everything found so far (outcome ``TIME_LIMIT``). The plan is the shortest one found from the cheapest one
    on; it may not be optimal, but ``least_duration`` is a lower bound.

    Raises:
        PlanningError: the problem is invalid.
    """
    began = clock()
    deadline = began + time_limit
    problem = staffed(team)
    domain, goal, goals = compiled(problem)
    doers = [team.doers.get(action.name, '') for action in domain.actions]
    initial = domain.state(problem.initial)
    divider = Divider(domain, goal, goals, doers, deadline, clock)
    divided = divider.divide(initial, report)
    found, division, expanded = divided.search, divided.division, divided.expanded
    reachability = Reachability(domain, initial)
    least = max((reachability.costs[literal] for literal in bits(goal)), default=0.0)
    least = max(least, found.bound / len(team.robots))
    result = TeamPlan(
        team=team,
        problem=problem,
        outcome=found.outcome,
        bound=found.bound,
        expanded=expanded,
        seconds=0.0,
        least_duration=least,
    )
    if division is None:
        reason = why_not(problem, reachability, goals) if found.outcome is SearchOutcome.UNSOLVABLE else ''
        return replace(result, seconds=clock() - began, reason=reason)
    alone = {robot: divider.alone(robot, initial).cost for robot in team.robots}
    branches = branches_of(domain, division, team.robots, doers)
    disturbances = [Disturbance.of(domain, one) for one in problem.disturbances]
    hopeless: dict[int, tuple[str, ...]] = {}
    while True:
        policy = Policy(domain, goals, branches, len(team.robots))
        coverage = explore_states(policy, initial, disturbances, disturbed, deadline, clock)
        missing = {state: way for state, way in coverage.uncovered.items() if state not in hopeless}
        if not missing or clock() >= deadline:
            coverage.complete &= not missing  # nothing is planned for these any more
            break
        for state, way in missing.items():
            if any(not branch.condition & ~state for branch in branches):
                continue
            other = divider.divide_alike(state)
            expanded += other.expanded
            if other.division is not None:
                branches += branches_of(domain, other.division, team.robots, doers)
            elif other.search.outcome is SearchOutcome.UNSOLVABLE:
                hopeless[state] = way
    tasks = sorted(
        (
            Task(doers[action], domain.actions[action].name, end - domain.costs[action], end)
            for action, end in zip(division.plan, division.ends, strict=True)
        ),
        key=lambda task: task.begins,
    )
    return replace(
        result,
        expanded=expanded,
        seconds=clock() - began,
        tasks=tuple(tasks),
        actions=tuple(task.action for task in tasks),
        duration=division.duration,
        cost=division.cost,
        alone=alone,
        policy=policy,
        coverage=coverage,
        hopeless=tuple(hopeless.values()),
    )
