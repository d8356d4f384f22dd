# SPDX-License-Identifier: BSD-3-Clause
"""A plan as a map: a region for each branch (the states in which it is the first that holds), with moves between
them."""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from enum import Enum

from .coverage import MOST_STATES, Disturbance, visits
from .planner import Plan
from .policy import Policy
from .problem import Domain, bits


class RegionKind(Enum):
    """The kind of a region; the value is its style in pictures."""

    BRANCH = 'Region'
    GOAL = 'Goal'
    NOWHERE = 'Nowhere'


class MoveKind(Enum):
    """The cause of a move between regions: an action when nothing disturbs, an action otherwise, or others. The value
    is its style in pictures."""

    PLANNED = 'planned'
    ACTION = 'onward'
    DISTURBANCE = 'disturbed'


@dataclass(frozen=True, slots=True)
class PlanRegion:
    """A region of the map. ``actions``: the action of each active robot. ``condition``: the literals of the branch, or
    the alternatives of the goal. ``left``: the most that remains to the goal: the cost, or the time for several
    robots."""

    kind: RegionKind
    actions: tuple[str, ...] = ()
    condition: tuple[str, ...] = ()
    left: float = 0.0


@dataclass(frozen=True, slots=True)
class RegionMove:
    """A move between two regions (indices); ``name`` is the name of the action or disturbance."""

    start: int
    end: int
    name: str
    kind: MoveKind


@dataclass(frozen=True, slots=True)
class RegionMap:
    """The reachable regions, in the order of their branches; ``start`` is the initial one."""

    regions: tuple[PlanRegion, ...]
    moves: tuple[RegionMove, ...]
    start: int


def region_map(plan: Plan) -> RegionMap:
    """Return the map of a plan, for all states that are reachable with the disturbances that its test allowed.

    Raises:
        ValueError: the search found no plan.
    """
    policy = plan.policy
    if policy is None or plan.coverage is None:
        raise ValueError('there is no plan, and so no map of it')
    domain = policy.domain
    initial = domain.state(plan.problem.initial)
    disturbances = [Disturbance.of(domain, one) for one in plan.problem.disturbances]
    places = {branch: place for place, branch in enumerate(policy.branches)}
    goal, nowhere = len(places), len(places) + 1

    def place_of(state: int) -> int:
        if policy.is_reached(state):
            return goal
        branch = policy.choose(state)
        return nowhere if branch is None else places[branch]

    def actions(state: int) -> tuple[int, ...]:
        return () if policy.is_reached(state) else policy.actions(state)

    moves: dict[tuple[int, int, str], MoveKind] = {}
    times = plan.coverage.disturbed
    most = MOST_STATES * (times + 1)
    for state, left, steps in itertools.islice(visits(domain, initial, actions, disturbances, times), most):
        kind = MoveKind.PLANNED if left == times else MoveKind.ACTION
        for after, rest, name in steps:
            move = place_of(state), place_of(after), name
            if move[0] != move[1] and moves.get(move) is not MoveKind.PLANNED:
                moves[move] = kind if rest == left else MoveKind.DISTURBANCE
    seen = sorted({place_of(initial), goal, *(one for move in moves for one in move[:2])})
    number = {place: index for index, place in enumerate(seen)}
    return RegionMap(
        tuple(_region(domain, policy, place) for place in seen),
        tuple(RegionMove(number[begin], number[end], name, kind) for (begin, end, name), kind in moves.items()),
        number[place_of(initial)],
    )


def _region(domain: Domain, policy: Policy, place: int) -> PlanRegion:
    if place > len(policy.branches):
        return PlanRegion(RegionKind.NOWHERE)
    if place == len(policy.branches):
        goals = tuple(' & '.join(_literals(domain, goal)) for goal in policy.goals)
        return PlanRegion(RegionKind.GOAL, condition=goals)
    branch = policy.branches[place]
    actions = tuple(domain.actions[action].name for action in branch.actions if action >= 0)
    return PlanRegion(RegionKind.BRANCH, actions, _literals(domain, branch.condition), branch.left[0])


def _literals(domain: Domain, condition: int) -> tuple[str, ...]:
    return tuple(domain.literals[literal] for literal in bits(condition))
