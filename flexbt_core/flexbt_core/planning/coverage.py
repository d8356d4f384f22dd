# SPDX-License-Identifier: BSD-3-Clause
"""Whether a tree reaches its goal, whatever of what is expected happens: each state that may come is tried.

From the initial state the tree acts, and before each of its actions (and at the goal) something may disturb it, up to a
number of times. In each state that may come so the tree has to reach the goal, in an action at most for each branch,
without coming to a state twice, and to choose what the planner chose.
"""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Final

from .compaction import Group, Rule, chosen
from .model import Domain, PlanningError
from .policy import Policy


@dataclass(frozen=True, slots=True)
class Disturbance:
    """What others may do: some literals become true, others false, where ``needs`` holds. All are bit sets."""

    name: str
    needs: int
    adds: int
    deletes: int

    def result(self, state: int) -> int | None:
        """The state after it; None where it changes nothing."""
        after = state & ~self.deletes | self.adds
        return after if not self.needs & ~state and after != state else None


@dataclass(slots=True)
class Coverage:
    """What was tried.

    ``states``: number of states. ``uncovered``: states that may come in which no branch holds, with what led there
    (names of actions and disturbances). ``complete``: whether all states were tried that may come after ``disturbed``
    disturbances. ``longest``: actions from a state to the goal at most.
    """

    disturbed: int
    states: int = 0
    complete: bool = True
    longest: int = 0
    uncovered: dict[int, tuple[str, ...]] = field(default_factory=dict)


MOST_STATES: Final = 20_000


def explore(
    policy: Policy,
    members: Sequence[Rule | Group],
    initial: int,
    disturbances: Sequence[Disturbance],
    times: int,
    deadline: float,
    clock: Callable[[], float] = time.perf_counter,
) -> Coverage:
    """Tries a tree from a state, with up to ``times`` disturbances, until the ``deadline`` or ``MOST_STATES`` states.

    Raises:
        PlanningError: the tree does not do what the planner promised. That is a fault of the planner.
    """
    coverage = Coverage(times)
    seen: dict[int, tuple[int, int, str] | None] = {initial: None}
    left = {initial: times}
    todo = deque([initial])
    lengths: dict[int, int] = {}
    while todo:
        if len(seen) > MOST_STATES or clock() >= deadline:
            coverage.complete = False
            break
        state = todo.popleft()
        coverage.states += 1
        action = None if policy.is_reached(state) else _action(policy, members, state)
        nexts: list[tuple[int, int, str]] = []
        if action is not None:
            coverage.longest = max(coverage.longest, _run(policy, members, state, lengths))
            nexts.append((policy.domain.result(state, action), left[state], policy.domain.actions[action].name))
        elif not policy.is_reached(state):
            coverage.uncovered[state] = _way(seen, state)
        if left[state]:
            for disturbance in disturbances:
                after = disturbance.result(state)
                if after is not None:
                    nexts.append((after, left[state] - 1, disturbance.name))
        for after, more, name in nexts:
            if after not in left or left[after] < more:
                seen.setdefault(after, (state, more, name))
                left[after] = more
                todo.append(after)
    return coverage


def _action(policy: Policy, members: Sequence[Rule | Group], state: int) -> int | None:
    branch = policy.choose(state)
    action = chosen(members, state)
    if action != (None if branch is None else branch.action):
        raise PlanningError(_fault(policy.domain, state, 'its compacted tree chooses something else than its branches'))
    return action


def _run(policy: Policy, members: Sequence[Rule | Group], state: int, lengths: dict[int, int]) -> int:
    """The number of actions to the goal. Raises PlanningError when the tree does not come there."""
    way: list[int] = []
    seen: set[int] = set()
    while state not in lengths and not policy.is_reached(state):
        action = _action(policy, members, state)
        if action is None or state in seen or policy.domain.needs[action] & ~state:
            raise PlanningError(_fault(policy.domain, state, 'its tree does not lead from here to the goal'))
        way.append(state)
        seen.add(state)
        state = policy.domain.result(state, action)
    length = lengths.get(state, 0)
    for passed in reversed(way):
        length += 1
        lengths[passed] = length
    return length


def _way(seen: dict[int, tuple[int, int, str] | None], state: int) -> tuple[str, ...]:
    way: list[str] = []
    at: int | None = state
    while at is not None and (before := seen[at]) is not None:
        way.append(before[2])
        at = before[0]
    return tuple(reversed(way))


def _fault(domain: Domain, state: int, what: str) -> str:
    literals = ', '.join(sorted(domain.condition(state)))
    return f'the planner is at fault, please report it: {what}. State: {literals:.2000}'
