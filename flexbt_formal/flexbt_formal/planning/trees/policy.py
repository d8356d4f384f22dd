# SPDX-License-Identifier: BSD-3-Clause
"""What to do in which state: branches in the order of what it costs from there to the goal."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Final, NamedTuple

from flexbt_formal.planning.backward_search import Step
from flexbt_formal.planning.problems import Domain

MOST_BRANCHES: Final = 500
"""Of a tree, beside those of the ways that it needs: a tree of thousands is slow, and nobody reads it."""


class Branch(NamedTuple):
    """Where ``condition`` (a bit set) holds, ``action`` is to be done, and the goal is reached at ``cost`` at most."""

    condition: int
    action: int
    cost: float


class Policy:
    """The branches of a tree that ticks them in their order: the first whose condition holds is the cheapest way known.

    Each branch leads to the goal or to an earlier branch, so from each state in which one holds the goal is reached, in
    as many actions as there are branches at most.

    Of the conditions ``goals`` one has to hold in the end. ``steps`` are as a search leaves them: the ``next`` of each
    is among them or a goal. Of the conditions ``starts`` each has its branch, and so have all on the way from there to
    the goal; of the others the MOST_BRANCHES cheapest have one.
    """

    def __init__(self, domain: Domain, goals: Iterable[int], steps: Mapping[int, Step], starts: Iterable[int]) -> None:
        self.domain: Final = domain
        self.goals: Final = tuple(goals)
        self.steps: Final = dict(steps)
        self.starts: Final = frozenset(starts)
        self.branches: Final[list[Branch]] = []
        needed = {condition for start in self.starts for condition in self._way(start)}
        earlier = list(self.goals)
        for condition, step in sorted(self.steps.items(), key=lambda item: (item[1].cost, len(self._way(item[0])))):
            if len(self.branches) >= MOST_BRANCHES and condition not in needed:
                continue
            # What an earlier one covers is never come to.
            if step.action is not None and not any(not other & ~condition for other in earlier):
                earlier.append(condition)
                self.branches.append(Branch(condition, step.action, step.cost))

    def _way(self, condition: int) -> list[int]:
        """The conditions from one to the goal."""
        way = [condition]
        while (step := self.steps[way[-1]]).action is not None:
            way.append(step.next)
        return way

    def is_reached(self, state: int) -> bool:
        """Whether one of the goals holds."""
        return any(not goal & ~state for goal in self.goals)

    def choose(self, state: int) -> Branch | None:
        """The branch that a tick comes to; None where none holds."""
        return next((branch for branch in self.branches if not branch.condition & ~state), None)

    def merged(self, other: Policy) -> Policy:
        """With what another search found; of two steps for one condition the cheaper one."""
        both = dict(self.steps)
        for condition, step in other.steps.items():
            if condition not in both or step.cost < both[condition].cost:
                both[condition] = step
        return Policy(self.domain, self.goals, both, self.starts | other.starts)
