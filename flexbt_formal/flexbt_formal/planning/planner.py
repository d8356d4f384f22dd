# SPDX-License-Identifier: BSD-3-Clause
"""Planning of a tree for a problem, and its test in all expected states."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final

from .coverage import Coverage, Disturbance, explore_states
from .policy import Branch, Policy
from .problem import Action, Domain, PlanningProblem, bits, predicate_of
from .relaxation import Reachability
from .search import RegressionStep, SearchOutcome, SearchProgress, SearchResult, search

GOAL: Final = 'any of the goals'


@dataclass(frozen=True, slots=True, kw_only=True)
class Plan:
    """The result of planning.

    ``cost`` and ``actions`` belong to the best plan from the initial state (None and empty without a plan). ``bound``
    is a lower bound of the cost. ``reason`` explains a missing plan. ``policy`` has the branches, ``coverage`` the
    result of their test; both are None without a plan. ``hopeless`` are paths (names of actions and disturbances)
    after which the goal is unreachable.
    """

    problem: PlanningProblem
    outcome: SearchOutcome
    bound: float
    expanded: int
    seconds: float
    cost: float | None = None
    actions: tuple[str, ...] = ()
    reason: str = ''
    policy: Policy | None = None
    coverage: Coverage | None = None
    hopeless: tuple[tuple[str, ...], ...] = ()


def plan(
    problem: PlanningProblem,
    *,
    time_limit: float = 60.0,
    disturbed: int = 1,
    report: Callable[[SearchProgress], None] | None = None,
    clock: Callable[[], float] = time.perf_counter,
) -> Plan:
    """Plan, and test the result in all states that are reachable with up to ``disturbed`` disturbances.

    States without a branch are planned for as well. ``time_limit`` is in seconds on the ``clock``. After it, the result
    contains everything found so far (outcome ``TIME_LIMIT``).

    Raises:
        PlanningError: the problem is invalid.
    """
    began = clock()
    deadline = began + time_limit
    domain, goal, goals = compiled(problem)
    initial = domain.state(problem.initial)
    reachability = Reachability(domain, initial)
    found = search(reachability, goal, time_limit=deadline - clock(), report=report, clock=clock)
    result = Plan(problem=problem, outcome=found.outcome, bound=found.bound, expanded=found.expanded, seconds=0.0)
    if found.start is None:
        reason = why_not(problem, reachability, goals) if found.outcome is SearchOutcome.UNSOLVABLE else ''
        return replace(result, seconds=clock() - began, reason=reason)
    expanded = found.expanded
    steps: dict[int, RegressionStep] = {}
    starts: list[int] = []

    def add(more: SearchResult, start: int) -> Policy:
        """Return the policy with the steps of a search added; of two steps for one condition, keep the cheaper."""
        starts.append(start)
        for condition, step in more.steps.items():
            if condition != goal and (condition not in steps or step.cost < steps[condition].cost):
                steps[condition] = step
        return policy_of(domain, goals, steps, starts)

    policy = add(found, found.start)
    disturbances = [Disturbance.of(domain, one) for one in problem.disturbances]
    hopeless: dict[int, tuple[str, ...]] = {}
    while True:
        coverage = explore_states(policy, initial, disturbances, disturbed, deadline, clock)
        missing = {state: way for state, way in coverage.uncovered.items() if state not in hopeless}
        if not missing or clock() >= deadline:
            coverage.complete &= not missing  # nothing is planned for these any more
            break
        for state, way in missing.items():
            if policy.choose(state) is not None:
                continue
            other = search(Reachability(domain, state), goal, time_limit=deadline - clock(), report=report, clock=clock)
            expanded += other.expanded
            if other.start is not None:
                policy = add(other, other.start)
            elif other.outcome is SearchOutcome.UNSOLVABLE:
                hopeless[state] = way
    named = (domain.actions[action].name for action in found.plan())
    return replace(
        result,
        expanded=expanded,
        seconds=clock() - began,
        cost=found.cost,
        actions=tuple(name for name in named if not name.startswith(GOAL)),
        policy=policy,
        coverage=coverage,
        hopeless=tuple(hopeless.values()),
    )


def compiled(problem: PlanningProblem) -> tuple[Domain, int, tuple[int, ...]]:
    """Return the domain, the target of the search, and the goals. If there are several, an action without cost leads
    from each goal to the target."""
    known = (*problem.initial, *(literal for one in problem.disturbances for literal in one.adds | one.needs))
    known += tuple(literal for one in problem.goal for literal in one if problem.knows(literal))
    if len(problem.goal) == 1:
        domain = Domain(problem.actions, known)
        goal = domain.mask(problem.goal[0])
        return domain, goal, (goal,)
    reached = [
        Action(f'{GOAL} {number}', condition, frozenset({GOAL}), frozenset(), 0.0)
        for number, condition in enumerate(problem.goal, 1)
    ]
    checked = Domain(problem.actions, known)
    for condition in problem.goal:
        checked.mask(condition)
    domain = Domain([*problem.actions, *reached], known)
    return domain, domain.mask({GOAL}), tuple(domain.mask(condition) for condition in problem.goal)


def policy_of(
    domain: Domain, goals: Sequence[int], steps: Mapping[int, RegressionStep], starts: Iterable[int]
) -> Policy:
    """Return the policy of the steps of searches: the ``next`` of each is among them or a goal. All conditions on the
    ways from the ``starts`` to the goal have their branches, of the others the cheapest."""

    def way(condition: int) -> list[int]:
        found = [condition]
        while found[-1] not in goals:
            found.append(steps[found[-1]].next)
        return found

    branches = [
        Branch(condition, (step.action,), (step.cost, step.cost, len(way(condition))))
        for condition, step in steps.items()
        if step.action is not None and condition not in goals
    ]
    return Policy(domain, goals, branches, needed={condition for start in starts for condition in way(start)})


def hopeless(problem: PlanningProblem) -> str:
    """Return why the goal is unreachable even in the delete relaxation with all disturbances; '' if it is reachable
    there."""
    others = tuple(replace(one, name=f'others: {one.name}', cost=0.0) for one in problem.disturbances)
    domain, _, goals = compiled(replace(problem, actions=(*problem.actions, *others), disturbances=()))
    reachability = Reachability(domain, domain.state(problem.initial))
    reached = [all(reachability.costs[literal] < math.inf for literal in bits(goal)) for goal in goals]
    return '' if any(reached) else why_not(problem, reachability, goals)


def why_not(problem: PlanningProblem, reachability: Reachability, goals: Iterable[int]) -> str:
    """Return why no goal is reachable."""
    return '; '.join(dict.fromkeys(_why_not_one(problem, reachability, goal) for goal in goals))


def _why_not_one(problem: PlanningProblem, reachability: Reachability, goal: int) -> str:
    literals = reachability.domain.literals
    for literal in bits(goal):
        if reachability.costs[literal] == math.inf:
            return _unreachable(problem, reachability, literal)
    for literal in bits(goal):
        for other in bits(reachability.exclusions.of[literal] & goal):
            return f'{literals[literal]} and {literals[other]} can never hold at once'
    names = ', '.join(literals[literal] for literal in bits(goal))
    return f'each of these can be reached, but not all at once: {names}'


def _unreachable(problem: PlanningProblem, reachability: Reachability, literal: int) -> str:
    """Return the chain of needs that ends at a literal that no action can make true."""
    domain = reachability.domain
    seen = {literal}
    text = domain.literals[literal]
    while True:
        name = domain.literals[literal]
        adders = [action for action, adds in enumerate(domain.adds) if adds >> literal & 1]
        if not adders:
            remedy = problem.remedies.get(predicate_of(name))
            return f'{text} does not hold, and no action brings it about{f" ({remedy})" if remedy else ""}'
        lacking = [need for need in bits(domain.needs[adders[0]]) if reachability.costs[need] == math.inf]
        new = next((need for need in lacking if need not in seen), None)
        if new is None:
            return f'{text} can only be had where it holds already{_nowhere(problem, name)}'
        seen.add(new)
        literal = new
        text = f'{text} needs {domain.literals[new]} (for {domain.actions[adders[0]].name}), and {domain.literals[new]}'


def _nowhere(problem: PlanningProblem, literal: str) -> str:
    """Return a hint on a missing start literal: a robot without an initial place cannot reach any place."""
    predicate = predicate_of(literal)
    is_anywhere = predicate == literal or any(predicate_of(one) == predicate for one in problem.initial)
    return '' if is_anywhere else f' (at the start no {predicate}(...) holds: is it missing there?)'
