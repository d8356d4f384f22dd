# SPDX-License-Identifier: BSD-3-Clause
"""What came of planning, as text for people and as a document for programs."""

from __future__ import annotations

import math
from typing import Any, Final

from flexbt_core.values import counted
from flexbt_formal.planning import Coverage, Outcome, Plan, TeamPlan

_MOST_WAYS: Final = 5


def plan_summary(found: Plan | TeamPlan) -> list[str]:
    """A plan, and what was tried of it, or why there is none; a line each."""
    spent = f'{found.expanded} conditions, {found.seconds:.2f} s'
    if found.policy is None or found.coverage is None:
        if found.outcome is Outcome.TIME_LIMIT:
            return [f'no plan within the time limit; none costs less than {found.bound:g} ({spent})']
        return [f'there is no plan: {found.reason} ({spent})']
    coverage = found.coverage
    shown = _team(found) if isinstance(found, TeamPlan) else _robot(found)
    tried = f'tried in {coverage.states} states ({"all" if coverage.complete else "not all"} that may come with'
    times = counted(coverage.disturbed, 'disturbance')
    if isinstance(found, TeamPlan):
        times += ', a lost robot among them' if coverage.disturbed and len(found.team.robots) > 1 else ''
        times += ', whichever action ends first'
    shown.append(
        f'{len(found.policy.branches)} branches; {tried} {times}): '
        f'the goal is {coverage.longest} actions away at most ({spent})'
    )
    ways = sorted(found.hopeless, key=len)
    shown += [f'no way to the goal after: {", ".join(way)}' for way in ways[:_MOST_WAYS]]
    if len(ways) > _MOST_WAYS:
        shown.append(f'... and after {len(ways) - _MOST_WAYS} more, which --json lists')
    return shown


def plan_document(found: Plan | TeamPlan, text: str | None) -> dict[str, Any]:
    """All of it; ``text`` is the tree."""
    own: dict[str, Any] = {'actions': found.actions} if isinstance(found, Plan) else _team_document(found)
    return {
        'outcome': found.outcome.value,
        'cost': found.cost,
        'bound': None if found.bound == math.inf else found.bound,
        **own,
        'reason': found.reason,
        'branches': 0 if found.policy is None else len(found.policy.branches),
        'expanded': found.expanded,
        'seconds': found.seconds,
        'coverage': None if found.coverage is None else _coverage(found.coverage),
        'hopeless': found.hopeless,
        'tree': text,
    }


def _coverage(coverage: Coverage) -> dict[str, Any]:
    return {
        'disturbances': coverage.disturbed,
        'states': coverage.states,
        'complete': coverage.complete,
        'longest': coverage.longest,
    }


def _robot(found: Plan) -> list[str]:
    optimal = (
        'the least' if found.outcome is Outcome.SOLVED else f'not proved to be the least, {found.bound:g} at least'
    )
    return [f'cost {found.cost:g} ({optimal}), {len(found.actions)} actions: {", ".join(found.actions) or "none"}']


def _team(found: TeamPlan) -> list[str]:
    alone = ', '.join(f'{robot} alone: {_cost(cost)}' for robot, cost in (found.alone or {}).items())
    shown = [
        f'done after {found.duration:g} ({found.least_duration:g} at least; {alone}), '
        f'cost {found.cost:g} together ({found.bound:g} at least), {len(found.tasks)} actions'
    ]
    for robot in found.team.robots:
        tasks = [f'{task.begins:g}–{task.ends:g} {task.action}' for task in found.tasks if task.robot == robot]
        shown.append(f'{robot}: {", ".join(tasks) or "nothing"}')
    if found.unlimited and len(found.team.robots) > 1:
        shown.append(
            f'no deadline: {", ".join(found.unlimited)}; where one of these never ends, the others wait for its robot: '
            'give it a deadline (s) in its manifest, after which they do without the robot'
        )
    return shown


def _cost(cost: float | None) -> str:
    return 'no way' if cost is None else f'{cost:g}'


def _team_document(found: TeamPlan) -> dict[str, Any]:
    return {
        'duration': found.duration,
        'least_duration': None if found.least_duration == math.inf else found.least_duration,
        'alone': found.alone,
        'actions': [task.action for task in found.tasks],
        'tasks': [task._asdict() for task in found.tasks],
        'unlimited': found.unlimited,
    }
