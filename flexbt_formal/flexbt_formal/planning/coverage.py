# SPDX-License-Identifier: BSD-3-Clause
"""Test of trees in each reachable state: do they reach the goal, whichever expected event happens?

The tree acts from the initial state (for a team, the action of any robot may end first). Before the end of each action,
and at the goal, a disturbance may occur, up to a maximum number. From each state that is reachable in this way, the
trees must reach the goal without visiting a state twice.
"""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from typing import Final

from .policy import Policy, fault
from .problem import Action, Domain, PlanningError


@dataclass(frozen=True, slots=True)
class Disturbance:
    """A change by others that may occur where ``needs`` holds: literals become true or false. All are bit sets."""

    name: str
    needs: int
    adds: int
    deletes: int

    @classmethod
    def of(cls, domain: Domain, action: Action) -> Disturbance:
        """Return the disturbance for an action of others."""
        deletes = domain.state(action.deletes - action.adds)
        return cls(action.name, domain.state(action.needs), domain.state(action.adds), deletes)

    def result(self, state: int) -> int | None:
        """Return the state after the disturbance; None if it changes nothing."""
        after = state & ~self.deletes | self.adds
        return after if not self.needs & ~state and after != state else None


@dataclass(slots=True)
class Coverage:
    """The result of a test of trees.

    ``states``: number of states. ``uncovered``: reachable states in which no branch holds, with the path to each (names
    of actions and disturbances). ``complete``: True if all states that are reachable with ``disturbed`` disturbances
    were tested. ``longest``: maximum number of actions from a state to the goal.
    """

    disturbed: int
    states: int = 0
    complete: bool = True
    longest: int = 0
    uncovered: dict[int, tuple[str, ...]] = field(default_factory=dict)


MOST_STATES: Final = 20_000


def explore_states(
    policy: Policy,
    initial: int,
    disturbances: Sequence[Disturbance],
    times: int,
    deadline: float,
    clock: Callable[[], float] = time.perf_counter,
) -> Coverage:
    """Test trees from a state, with up to ``times`` disturbances, until the ``deadline`` or ``MOST_STATES`` states.

    The undisturbed path from that state to the goal is always tested.

    Raises:
        PlanningError: the trees do not reach the goal as planned, which is a bug of the planner.
    """
    coverage = Coverage(times)
    runs = _Runs(policy)
    tested: set[int] = set()
    before: dict[int, tuple[int, str] | None] = {initial: None}
    for state, _, steps in visits(policy.domain, initial, runs.actions, disturbances, times):
        if tested and (len(before) > MOST_STATES or clock() >= deadline):
            coverage.complete = False
            break
        tested.add(state)
        if runs.actions(state):
            coverage.longest = max(coverage.longest, runs.longest(state))
        elif not policy.is_reached(state):
            coverage.uncovered[state] = _way(before, state)
        for after, _, name in steps:
            before.setdefault(after, (state, name))
    coverage.states = len(tested)
    return coverage


def visits(
    domain: Domain,
    initial: int,
    actions: Callable[[int], Sequence[int]],
    disturbances: Sequence[Disturbance],
    times: int,
) -> Iterator[tuple[int, int, list[tuple[int, int, str]]]]:
    """Yield each reachable state, the remaining disturbances, and its steps, breadth first.

    A step is the next state, the disturbances remaining there, and the name of the action or disturbance. A state is
    yielded again if more disturbances remain than before.
    """
    left = {initial: times}
    todo = deque([initial])
    while todo:
        state = todo.popleft()
        more = left[state]
        steps = [(domain.result(state, one), more, domain.actions[one].name) for one in actions(state)]
        for disturbance in disturbances if more else ():
            after = disturbance.result(state)
            if after is not None:
                steps.append((after, more - 1, disturbance.name))
        yield state, more, steps
        for after, rest, _ in steps:
            if left.get(after, -1) < rest:
                left[after] = rest
                todo.append(after)


class _Runs:
    """The undisturbed paths from states to the goal."""

    def __init__(self, policy: Policy) -> None:
        self._policy = policy
        self._actions: dict[int, tuple[int, ...]] = {}
        self._lengths: dict[int, int] = {}

    def actions(self, state: int) -> tuple[int, ...]:
        if state not in self._actions:
            self._actions[state] = () if self._policy.is_reached(state) else self._policy.actions(state)
        return self._actions[state]

    def longest(self, state: int) -> int:
        """Return the maximum number of actions to the goal. Raises PlanningError if some path does not reach the
        goal."""
        domain = self._policy.domain
        begun: set[int] = set()
        todo = [state]
        while todo:
            at = todo[-1]
            actions = self.actions(at)
            afters = [domain.result(at, action) for action in actions]
            missing = [after for after in afters if after not in self._lengths]
            lost = not actions and not self._policy.is_reached(at)
            if lost or begun.intersection(missing) or any(domain.needs[action] & ~at for action in actions):
                raise PlanningError(fault(domain, at, 'its tree does not lead from here to the goal'))
            if missing:
                begun.add(at)
                todo += missing
                continue
            todo.pop()
            begun.discard(at)
            self._lengths[at] = max((1 + self._lengths[after] for after in afters), default=0)
        return self._lengths[state]


def _way(before: dict[int, tuple[int, str] | None], state: int) -> tuple[str, ...]:
    way: list[str] = []
    while (step := before[state]) is not None:
        state, name = step
        way.append(name)
    return tuple(reversed(way))
