# SPDX-License-Identifier: BSD-3-Clause
"""Which actions of a plan have to wait for which, when each robot does its own as soon as it may."""

from __future__ import annotations

from collections.abc import Sequence

from flexbt_formal.planning.problems import Domain


def predecessors(domain: Domain, plan: Sequence[int], doers: Sequence[str]) -> list[int]:
    """For each place of a plan the places that have to be done before, as bit sets.

    In each order that keeps to that, all actions can be done, and the same holds in the end. ``doers`` are by the
    numbers of actions.
    """
    found = []
    for place, action in enumerate(plan):
        before = 0
        for earlier, other in enumerate(plan[:place]):
            if doers[action] == doers[other] or _depend(domain, action, other):
                before |= 1 << earlier
        found.append(before)
    return found


def ends(domain: Domain, plan: Sequence[int], before: Sequence[int], done: int = 0) -> list[float]:
    """When each action of a plan ends, if costs are durations and each begins as soon as it may; 0 for what is ``done``
    (a bit set of places)."""
    found: list[float] = []
    for place, action in enumerate(plan):
        if done >> place & 1:
            found.append(0.0)
            continue
        begins = max((end for earlier, end in enumerate(found) if before[place] >> earlier & 1), default=0.0)
        found.append(begins + domain.costs[action])
    return found


def _depend(domain: Domain, one: int, other: int) -> bool:
    """Whether it matters which of two actions comes first: one changes what the other needs or brings about."""
    return bool(
        domain.adds[one] & domain.needs[other]
        or domain.adds[other] & domain.needs[one]
        or domain.deletes[one] & (domain.needs[other] | domain.adds[other])
        or domain.deletes[other] & (domain.needs[one] | domain.adds[one])
    )
