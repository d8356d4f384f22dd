# SPDX-License-Identifier: BSD-3-Clause
"""From a problem for several robots to what each of them does, tried before it is given out."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

from flexbt_formal.planning.backward_search import Outcome, Progress, Reachability
from flexbt_formal.planning.problems import Problem, bits
from flexbt_formal.planning.trees import Coverage, Disturbance, actions_of, compiled, explore, why_not

from .division import Divider
from .team import Team, staffed
from .team_policy import WAITS, TeamBranch, TeamPolicy, branches_of


class Task(NamedTuple):
    """An action of a robot, and when it begins and ends if costs are durations and nothing hinders."""

    robot: str
    action: str
    begins: float
    ends: float


@dataclass(frozen=True, slots=True)
class TeamPlan:
    """What came of planning for several robots.

    ``tasks`` are the plan in the order in which they begin, ``duration`` when the last is done, ``cost`` the costs
    together; ``bound`` is what no plan can cost less than, and ``least_duration`` what none can take less than.
    ``alone`` has for each robot what it would cost it alone (None: it cannot, or it is not known). ``reason`` says why
    there is no plan. ``policy`` and ``coverage`` are None without a plan. ``hopeless`` are ways (names of actions and
    disturbances) after which the goal cannot be reached any more.
    """

    team: Team
    problem: Problem
    outcome: Outcome
    bound: float
    expanded: int
    seconds: float
    least_duration: float = 0.0
    tasks: tuple[Task, ...] = ()
    duration: float | None = None
    cost: float | None = None
    alone: dict[str, float | None] | None = None
    reason: str = ''
    policy: TeamPolicy | None = None
    coverage: Coverage | None = None
    hopeless: tuple[tuple[str, ...], ...] = ()

    @property
    def unlimited(self) -> tuple[str, ...]:
        """The types of its leaves that have no deadline: a robot in one that never ends is not known to be lost."""
        members = self.policy.members if self.policy is not None else ()
        actions = {action for robot in members for action in actions_of(robot)} - {WAITS}
        leaves = (self.problem.leaf(self.problem.actions[action].name) for action in actions)
        return tuple(sorted({leaf.type for leaf in leaves if leaf.deadline is None}))


def plan_team(
    team: Team,
    *,
    time_limit: float = 60.0,
    disturbed: int = 1,
    report: Callable[[Progress], None] | None = None,
    clock: Callable[[], float] = time.perf_counter,
) -> TeamPlan:
    """Plans for several robots, and tries the result in all states that may come after up to ``disturbed``
    disturbances, of which a robot that is lost is one.

    What is found to be missing after a disturbance is planned, too. ``time_limit`` is in seconds on the ``clock``; when
    it is over, the result has what was found until then (outcome ``TIME_LIMIT``). The plan is the shortest that is
    found from the cheapest one on; that there is no shorter one is not said, but for ``least_duration``.

    Raises:
        PlanningError: the problem is not as it has to be.
    """
    began = clock()
    deadline = began + time_limit
    problem = staffed(team)
    domain, goal, goals = compiled(problem)
    doers = [team.doers.get(action.name, '') for action in domain.actions]
    initial = domain.state(problem.initial)
    divider = Divider(domain, goal, goals, doers, clock)
    divided = divider.divide(initial, deadline, report)
    found, division, expanded = divided.search, divided.division, divided.expanded
    reachability = Reachability(domain, initial)
    least = max((reachability.costs[literal] for literal in bits(goal)), default=0.0)
    least = max(least, found.bound / len(team.robots))
    if division is None:
        reason = why_not(problem, reachability, goals) if found.outcome is Outcome.UNSOLVABLE else ''
        return TeamPlan(team, problem, found.outcome, found.bound, expanded, clock() - began, least, reason=reason)
    alone = {robot: divider.alone(robot, initial, deadline).cost for robot in team.robots}
    branches: list[TeamBranch] = branches_of(domain, division, team.robots, doers)
    disturbances = [Disturbance.of(domain, one) for one in problem.disturbances]
    hopeless: dict[int, tuple[str, ...]] = {}
    while True:
        policy = TeamPolicy(domain, goals, team.robots, branches)
        coverage = explore(policy, initial, disturbances, disturbed, deadline, clock)
        missing = {state: way for state, way in coverage.uncovered.items() if state not in hopeless}
        if not missing or clock() >= deadline:
            break
        for state, way in missing.items():
            if any(not branch.condition & ~state for branch in branches):
                continue
            other = divider.divide_alike(state, deadline)
            expanded += other.expanded
            if other.division is not None:
                branches += branches_of(domain, other.division, team.robots, doers)
            elif other.search.outcome is Outcome.UNSOLVABLE:
                hopeless[state] = way
    tasks = sorted(
        (
            Task(doers[action], domain.actions[action].name, end - domain.costs[action], end)
            for action, end in zip(division.plan, division.ends, strict=True)
        ),
        key=lambda task: task.begins,
    )
    return TeamPlan(
        team,
        problem,
        found.outcome,
        found.bound,
        expanded,
        clock() - began,
        least,
        tuple(tasks),
        division.duration,
        division.cost,
        alone,
        policy=policy,
        coverage=coverage,
        hopeless=tuple(hopeless.values()),
    )
